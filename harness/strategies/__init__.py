"""Strategies: one file per family, one table (``registry``), nothing of the engine."""
