"""Runs of encounters: tasks, workers, parts; replays, candidates, and the worst episodes."""
