"""Takes findings and returns screens, tables and JSON."""
