"""Simulates a task, or one arm of a pair, according to its kind of run."""
