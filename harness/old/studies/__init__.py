"""Takes scenarios and returns finished runs, comparisons, replays, risks and validations."""
