"""Strategies of the user: ``package.module:Class``, importable from the working directory."""

import importlib
import operator
import pkgutil
import sys
from pathlib import Path
from types import ModuleType

from harness.core.errors import InputError, Place, in_one_line, nearest_name
from harness.core.vocabulary import StrategyFactory

_FORM = "package.module:Class"
"""The form of the name of a user's strategy."""


def is_of_this_process(name: str) -> bool:
    """Whether a name stands for a class of this script or notebook."""
    return name.startswith("__main__:")


def load_own(name: str, where: Place) -> StrategyFactory:
    """The strategy of a name such as ``package.module:MyStrategy``.

    Modules of the working directory can be imported, in worker processes too.

    Raises:
        InputError: the module or class does not exist, the module cannot be imported, or the class
            is not a strategy.
    """
    here = str(Path.cwd())
    if here not in sys.path:
        # `python -m harness` adds the working directory; the console script does not.
        sys.path.insert(0, here)
    module_name, _, path = name.partition(":")
    parts = [*module_name.split("."), *path.split(".")]
    if not all(part.isidentifier() for part in parts):
        raise InputError(where, f"{name!r} is not a strategy's name", _FORM)
    module = _import(module_name, where)
    try:
        strategy = operator.attrgetter(path)(module)
    except AttributeError:
        raise _unknown_class(module, path, where) from None
    if not isinstance(strategy, type) or not callable(getattr(strategy, "decide", None)):
        raise InputError(where, f"{name!r} is not a strategy", "a class with a method decide")
    return strategy


def _import(name: str, where: Place) -> ModuleType:
    if name not in sys.modules:
        # Python caches the contents of folders; a new module would not be found.
        importlib.invalidate_caches()
    try:
        return importlib.import_module(name)
    except (Exception, SystemExit) as error:
        missing = error.name if isinstance(error, ModuleNotFoundError) else None
        if missing is not None and f"{name}.".startswith(f"{missing}."):
            raise _unknown_module(missing, where) from None
        raise InputError(where, f"{name!r} cannot be imported: {in_one_line(error)}") from None


def _unknown_module(missing: str, where: Place) -> InputError:
    """The error for a module that does not exist; it holds the nearest name in the same folder."""
    package, _, last = missing.rpartition(".")
    folders = getattr(sys.modules.get(package), "__path__", []) if package else [str(Path.cwd())]
    names = [module.name for module in pkgutil.iter_modules(folders)]
    close = nearest_name(last, names)
    nearest = f"{package}.{close}" if package and close else close
    allowed = f"{_FORM}, importable from the working directory"
    return InputError(where, f"there is no module {missing!r}", allowed, nearest)


def _unknown_class(module: ModuleType, path: str, where: Place) -> InputError:
    strategies = [
        name for name, thing in vars(module).items() if callable(getattr(thing, "decide", None))
    ]
    allowed = ", ".join(sorted(strategies)) or "a class with a method decide"
    nearest = nearest_name(path, strategies)
    return InputError(where, f"{module.__name__!r} has no {path!r}", allowed, nearest)
