"""How ego and pedestrians move, and when they touch: geometry in the road frame, exact."""
