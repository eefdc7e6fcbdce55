"""What a driver is shown of the pedestrians: late, in part, with errors, and not through walls."""
