"""How rare an event is: sampling in the space of the uniforms behind an episode."""
