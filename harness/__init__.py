"""Judges an automated vehicle's strategy at an unsignalized crosswalk, in SUMO.

What is named in ``__init__.pyi`` is the public interface (docs/python.md); everything else may
change.  A name is imported when it is first used, so ``harness --help`` does not wait for pandas.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
