"""Episodes of a stored run, run again: with SUMO's own outputs, or before one's eyes."""
