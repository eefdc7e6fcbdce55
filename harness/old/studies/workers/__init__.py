"""Takes tasks and returns their results, from processes on this machine or on a cluster."""
