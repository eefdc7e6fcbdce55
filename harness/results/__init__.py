"""The tables of a run, its folder on disk, and the summary of each cell."""
