"""Searches a strategy's parameters under limits, and judges the best candidate on fresh pairs."""
