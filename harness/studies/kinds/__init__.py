"""How each kind of run is simulated: a task in a worker, or one arm of a pair once more."""
