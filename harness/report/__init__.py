"""What people read: the terminal's tables, figures."""
