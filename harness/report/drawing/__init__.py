"""Numbers in; matplotlib drawings in one style out."""
