"""Takes numbers and draws matplotlib figures in one style."""
