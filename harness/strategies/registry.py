"""The table of built-in strategies, and the search for the user's strategies by name."""

import hashlib
import inspect
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import cast

from harness.core.errors import InputError, Place, nearest_name
from harness.core.files import read_file
from harness.core.freezing import frozen
from harness.core.vocabulary import StrategyFactory
from harness.strategies.autoware_crosswalk import AutowareCrosswalk
from harness.strategies.constant_speed import ConstantSpeed
from harness.strategies.emergency_brake import EmergencyBrake
from harness.strategies.gap_yield import GapYield
from harness.strategies.hard_yield import HardYield
from harness.strategies.human_gmm import HumanGmm
from harness.strategies.human_recorded import HumanRecorded
from harness.strategies.human_yield import HumanYield
from harness.strategies.own import load_own
from harness.strategies.program import ProgramDriver, is_program, load_program
from harness.strategies.soft_yield import SoftYield
from harness.strategies.sumo_driver import SumoDriver

STRATEGIES: Mapping[str, StrategyFactory] = frozen({
    "soft_yield": SoftYield,
    "hard_yield": HardYield,
    "constant_speed": ConstantSpeed,
    "human_gmm": HumanGmm,
    "human_yield": HumanYield,
    "human_recorded": HumanRecorded,
    "emergency_brake": EmergencyBrake,
    "gap_yield": GapYield,
    "autoware_crosswalk": AutowareCrosswalk,
    "sumo_driver": SumoDriver,
})  # fmt: skip


def find_strategy(name: str, where: Place) -> StrategyFactory:
    """The strategy with a name: built-in, ``package.module:Class`` or a program.

    Raises:
        InputError: the name is unknown or cannot be imported; ``where`` is the key that has it.
    """
    if name in STRATEGIES:
        return STRATEGIES[name]
    if is_program(name):
        return load_program(name, where)
    if ":" in name:
        return load_own(name, where)
    names = sorted(STRATEGIES)
    allowed = ", ".join([*names, "or your own as package.module:Class or exec:./PROGRAM"])
    is_module = Path(f"{name.replace('.', '/')}.py").is_file()
    nearest = f"{name}:Class" if is_module else nearest_name(name, names)
    raise InputError(where, f"unknown strategy {name!r}", allowed, nearest)


def source_digests(names: Iterable[str]) -> dict[str, str]:
    """sha256 of the modules of each strategy that is not built in, which identifies its code."""
    digests = {}
    for name in sorted({*names} - {*STRATEGIES}):
        content = _source_of(find_strategy(name, "arms"))
        digests[name] = "unknown" if content is None else hashlib.sha256(content).hexdigest()
    return digests


def _source_of(strategy: StrategyFactory) -> bytes | None:
    """The source of a strategy's modules or, in a notebook, of its methods; None without either."""
    if isinstance(strategy, type) and issubclass(strategy, ProgramDriver):
        return read_file(Path(strategy.COMMAND[0]))
    with suppress(OSError, TypeError):  # its module has no file
        return b"".join(map(Path.read_bytes, _own_files(cast(type, strategy))))
    with suppress(OSError):
        functions = filter(inspect.isfunction, vars(strategy).values())
        return "".join(map(inspect.getsource, functions)).encode()
    return None


def _own_files(strategy: type) -> list[Path]:
    """The file of a strategy's module, and the files of the user's modules that it imports.

    These lie below the working directory or beside the strategy's module or package.  They are
    found in the sources, so they do not depend on what else this process has imported.  Installed
    packages, and imports whose names are computed, are left out.

    Raises:
        OSError, TypeError: its module has no file.
    """
    from modulefinder import ModuleFinder  # few runs need it

    file = Path(inspect.getfile(strategy))
    in_package = file.with_name("__init__.py").is_file()
    module = strategy.__module__.replace("__main__", file.stem) if in_package else file.stem
    folders = [file.parents[module.count(".")], Path.cwd()]
    own = [str(each) for each in folders if each.name not in ("site-packages", "dist-packages")]
    finder = ModuleFinder(own, excludes=["harness"])
    with suppress(ImportError, SyntaxError, AttributeError):  # the last: folders that are packages
        finder.import_hook(module)  # without __init__.py, of which it knows nothing
    found = {Path(of) for each in finder.modules.values() if (of := vars(each)["__file__"])}
    return [file, *sorted(found - {file})]


def aggressiveness_of(name: str) -> Mapping[str, float]:
    """Parameters of a built-in strategy that are its aggressiveness, each with its sign.

    They are the attribute ``AGGRESSIVENESS`` of its class.  Strategies of the user have none, since
    their code may be missing when results are read.
    """
    signs: Mapping[str, float] = getattr(STRATEGIES.get(name), "AGGRESSIVENESS", {})
    return signs


def fallback_of(name: str) -> str:
    """The strategy that drives if one has no valid plan: ``FALLBACK`` of a built-in class."""
    fallback: str = getattr(STRATEGIES.get(name), "FALLBACK", "its fallback")
    return fallback


def table_key(name: str) -> str:
    """The key of a strategy's table in a scenario file; names with a colon are quoted."""
    return f'strategies."{name}"' if ":" in name else f"strategies.{name}"
