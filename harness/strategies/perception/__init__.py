"""Pedestrians as a driver is shown them: late, in part, with errors, and not through walls."""
