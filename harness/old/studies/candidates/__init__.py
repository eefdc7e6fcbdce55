"""Many candidates on the same people, without a run folder."""
