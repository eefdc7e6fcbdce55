"""Judges an automated vehicle's strategy at an unsignalized crosswalk, in SUMO."""
