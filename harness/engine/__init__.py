"""Engines: what moves the ego and the pedestrians.  libsumo is imported in ``sumo`` alone."""
