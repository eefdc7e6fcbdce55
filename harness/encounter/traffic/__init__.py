"""A scenario with [traffic] and a pair's number in; the logs and passages of its hours out."""
