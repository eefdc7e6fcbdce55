"""A user's own SUMO scenario in; its running simulation out, with its output files redirected."""
