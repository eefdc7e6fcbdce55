"""Perception errors: pedestrians that a driver sees late, in part, with errors or not at all."""
