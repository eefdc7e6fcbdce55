"""Arguments of the command line in; calls of the rooms, output and exit codes out."""
