"""Findings in; screens, tables and JSON out."""
