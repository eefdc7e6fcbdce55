"""The command line: arguments in, calls of the other rooms, output and exit codes out."""
