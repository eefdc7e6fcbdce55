"""Stored runs read and compared.  Nothing is simulated."""
