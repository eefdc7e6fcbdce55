"""The command line: thin; what a command calls is imported when it is called."""
