"""What every room shares: the vocabulary of an encounter, errors, random streams, files."""
