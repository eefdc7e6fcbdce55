"""Numbers in; drawings into matplotlib's axes, and their style, out."""
