"""A user's own strategy: ``package.module:Class`` in the working directory, or an entry point."""

import importlib
import operator
import pkgutil
import sys
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType

from harness.core.encounter import StrategyFactory
from harness.core.errors import InputError, in_one_line, nearest_name

GROUP = "harness.strategies"
"""The entry point group in which an installed package names its strategies."""

_FORM = "package.module:Class"


@lru_cache
def installed() -> dict[str, EntryPoint]:
    """Strategies that installed packages bring, by name."""
    return {point.name: point for point in entry_points(group=GROUP)}


def is_of_this_process(name: str) -> bool:
    """Whether a strategy's name is that of a class of this script or notebook."""
    return name.startswith("__main__:")


def load_own(name: str, where: str) -> StrategyFactory:
    """The strategy of an entry point, or that of a name such as ``package.module:MyStrategy``.

    The working directory is importable, in worker processes too: they are started in it.

    Raises:
        InputError: no such module or class, the module cannot be imported, or it is no strategy.
    """
    if name in installed():
        return load_once(installed()[name].value.partition("[")[0].strip(), where)
    if is_of_this_process(name):
        # The cell of a notebook may have been run again.
        return _load(name, where)
    here = str(Path.cwd())
    if here not in sys.path:
        # The console script has its own folder there, `python -m harness` the working directory.
        sys.path.insert(0, here)
    return load_once(name, where)


@lru_cache
def load_once(name: str, where: str) -> StrategyFactory:
    """The class that a name stands for, imported once per process."""
    return _load(name, where)


def _load(name: str, where: str) -> StrategyFactory:
    module_name, _, path = name.partition(":")
    parts = [*module_name.split("."), *path.split(".")]
    if not all(part.isidentifier() for part in parts):
        raise InputError(where, f"{name!r} names no strategy", _FORM)
    module = _import(module_name, where)
    try:
        strategy = operator.attrgetter(path)(module)
    except AttributeError:
        raise _unknown_class(module, path, where) from None
    if not isinstance(strategy, type) or not callable(getattr(strategy, "decide", None)):
        raise InputError(where, f"{name!r} is no strategy", "a class with a method decide")
    return strategy


def _import(name: str, where: str) -> ModuleType:
    # A module written since Python last looked into its folder has to be seen.
    importlib.invalidate_caches()
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is not None and f"{name}.".startswith(f"{error.name}."):
            raise _unknown_module(error.name, where) from None
        raise InputError(where, f"{name!r} cannot be imported: {in_one_line(error)}") from None
    except (Exception, SystemExit) as error:
        raise InputError(where, f"{name!r} cannot be imported: {in_one_line(error)}") from None


def _unknown_module(missing: str, where: str) -> InputError:
    """The refusal of a module that is not there, with the nearest one beside it."""
    package, _, last = missing.rpartition(".")
    folders = (
        list(getattr(sys.modules.get(package), "__path__", [])) if package else [str(Path.cwd())]
    )
    there = [module.name for module in pkgutil.iter_modules(folders)]
    close = nearest_name(last, there)
    nearest = f"{package}.{close}" if package and close else close
    allowed = f"{_FORM}, importable from the working directory"
    return InputError(where, f"there is no module {missing!r}", allowed, nearest)


def _unknown_class(module: ModuleType, path: str, where: str) -> InputError:
    strategies = [
        name for name, thing in vars(module).items() if callable(getattr(thing, "decide", None))
    ]
    allowed = ", ".join(sorted(strategies)) or "a class with a method decide"
    return InputError(
        where, f"{module.__name__!r} has no {path!r}", allowed, nearest_name(path, strategies)
    )
