"""A study from scenario to run folder: begun, interrupted, resumed, finished, scored anew."""
