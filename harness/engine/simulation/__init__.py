"""A user's own SUMO scenario in; the same scenario running under our eyes out."""
