"""Views of results: screens, the page, its figures and its player.  They compute nothing."""
