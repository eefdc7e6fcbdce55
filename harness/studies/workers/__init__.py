"""Tasks, and the processes that carry them out: on this machine or on a cluster."""
