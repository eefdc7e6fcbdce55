"""Passages in a SUMO simulation that is not built by the harness: a user's own."""
