"""Raw trajectories in; rows of the interaction model's variables out."""
