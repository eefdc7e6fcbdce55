"""Arrays and bounds in; a truncated Gaussian mixture out."""
