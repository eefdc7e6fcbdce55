"""A whole SUMO configuration, run with strategies in a share of its vehicles."""
