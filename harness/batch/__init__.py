"""A study from scenario to finished run folder: begun, interrupted, resumed, finished."""
