"""Recorded trajectories in; the fitted model of walking and driving speeds out."""
