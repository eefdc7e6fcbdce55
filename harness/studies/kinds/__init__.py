"""Takes a task, or one arm of a pair, and simulates it as its kind of run requires."""
