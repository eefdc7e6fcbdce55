"""Repeats episodes of a stored run: with SUMO's own outputs, or visibly in sumo-gui."""
