"""Stored runs looked at: read, compared, scored anew.  Nothing is simulated."""
