"""What people read: words and tables on the terminal, figures, the page of a run."""
