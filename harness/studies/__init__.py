"""Scenarios in; finished runs, comparisons, replays, risks and validations out."""
