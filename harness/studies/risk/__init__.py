"""Estimates how rare an event is, by sampling the uniforms behind an episode."""
