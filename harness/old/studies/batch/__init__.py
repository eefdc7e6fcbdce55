"""Carries out a study from scenario to run folder: start, resume and finish."""
