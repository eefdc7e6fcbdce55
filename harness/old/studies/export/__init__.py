"""Takes a pair of a finished run; writes its trajectories and its road for other tools."""
