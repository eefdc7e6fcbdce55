"""Findings, drawings and traces in; pages of HTML out."""
