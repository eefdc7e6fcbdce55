"""Reads and compares stored runs, without simulation."""
