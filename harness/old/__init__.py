"""The rooms that serve what the new way does not serve yet; they only shrink."""
