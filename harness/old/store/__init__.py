"""Traces and findings in; the tables of a run folder out, and back."""
