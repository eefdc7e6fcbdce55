"""Command-line arguments come in; printed results and exit codes go out."""
