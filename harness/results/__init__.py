"""From rows to findings: tables and parts, estimators, the catalogue, notes, results."""
