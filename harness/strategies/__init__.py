"""Observations of a vehicle's surroundings in; acceleration commands out."""
