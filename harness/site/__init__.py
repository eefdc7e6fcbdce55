"""A SUMO network in; the geometry of the crosswalks on it out."""
