"""Speeds of vehicles and positions of pedestrians in; their simulated motion out."""
