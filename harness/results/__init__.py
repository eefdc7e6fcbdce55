"""What a run leaves behind: its tables, its folder on disk, what is reported of each cell."""
