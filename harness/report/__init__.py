"""Everything that people read: words and tables on the terminal, figures, pages."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submodules=["figures"])
