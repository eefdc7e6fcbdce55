"""Rows of users' own simulations in; their tables, findings and statistics out."""
