"""A user's own SUMO scenario or its recording in; passages over its crosswalks out."""
