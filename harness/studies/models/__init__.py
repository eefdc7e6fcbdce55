"""What is done with trajectories: fits, the card of a model, validation, recorded passages."""
