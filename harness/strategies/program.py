"""A strategy in another process, whatever its language: ``exec:./my_driver --flag``.

The program reads one JSON line for each observation from its standard input and writes one number
to its standard output.  ``observation.schema.json`` beside this file defines the form of a line
(docs/strategies.md).
"""

import json
import os
import select
import shlex
import subprocess
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path
from time import monotonic
from typing import Any, ClassVar

from harness.core.encounter import Crossing, Observation, StrategyFactory, Vehicle
from harness.core.errors import InputError

PREFIX = "exec:"

SCHEMA_FILE = Path(__file__).with_name("observation.schema.json")
"""The schema of a line."""

_NEWLINE = b"\n"
_LONGEST_ANSWER = 1_000
"""Greatest length of an answer in bytes; a number has fewer."""


def is_program(name: str) -> bool:
    """Whether a strategy's name stands for a program."""
    return name.startswith(PREFIX)


@lru_cache
def load_program(name: str, where: str) -> StrategyFactory:
    """The strategy that a name such as ``exec:./my_driver --flag`` stands for.

    The program must lie in the working directory or below it, so that a scenario from somebody else
    can start only programs that you put there.

    Raises:
        InputError: the program does not exist or cannot be executed.
    """
    allowed = "exec:./PROGRAM ARGUMENTS, a program below the working directory"
    try:
        words = shlex.split(name.removeprefix(PREFIX))
    except ValueError as error:
        raise InputError(where, f"{name!r} is not a command ({error})", allowed) from None
    if not words:
        raise InputError(where, f"{name!r} has no program", allowed)
    here = Path.cwd().resolve()
    path = (here / words[0]).resolve()
    if not path.is_relative_to(here):
        raise InputError(where, f"{words[0]!r} is not below the working directory", allowed)
    if not path.is_file():
        raise InputError(where, f"there is no program {words[0]!r}", allowed)
    if not os.access(path, os.X_OK):
        raise InputError(where, f"{words[0]!r} cannot be executed", f"chmod +x {words[0]}")
    return type("Program", (ProgramDriver,), {"COMMAND": (str(path), *words[1:])})


class ProgramDriver:
    """An external program that reads a JSON line and answers with a commanded acceleration.

    Each worker starts it once and uses it for one episode after another; ``time_s = 0`` begins a
    new episode.  It must end when its standard input ends.

    Args:
        answer_limit_s: wall time for one answer, including the program's start.  If it takes
            longer, the program is ended and the episode fails; the next episode starts it again.
    """

    COMMAND: ClassVar[tuple[str, ...]] = ()

    def __init__(self, *, answer_limit_s: float = 5.0) -> None:
        if not answer_limit_s > 0:
            raise InputError("answer_limit_s", f"{answer_limit_s:g} s", "above 0")
        self._limit_s = answer_limit_s

    def decide(self, observation: Observation, /) -> Any:
        """The program's answer in m/s², or None (``null``), SUMO's own driver in a simulation."""
        program = _running_program(self.COMMAND)
        try:
            program.say(line_of(observation))
            answer = program.answer(self._limit_s)
        except Exception:
            _end(self.COMMAND)
            raise
        try:
            return json.loads(answer)
        except ValueError:
            _end(self.COMMAND)
            problem = f"the program answered {answer[:80]!r}, which is not a number"
            raise ValueError(problem) from None


class _Running:
    """A running program; it reads one line and writes one line."""

    def __init__(self, command: tuple[str, ...]) -> None:
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._stdin, self._stdout = self._process.stdin.fileno(), self._process.stdout.fileno()
        self._rest = b""

    def say(self, line: bytes) -> None:
        """Write a line."""
        try:
            while line:
                line = line[os.write(self._stdin, line) :]
        except BrokenPipeError:
            raise ChildProcessError(self._why_gone()) from None

    def answer(self, limit_s: float) -> bytes:
        """The next line without its line end."""
        until_s = monotonic() + limit_s
        while _NEWLINE not in self._rest:
            ready, _, _ = select.select([self._stdout], [], [], max(0.0, until_s - monotonic()))
            if not ready:
                raise TimeoutError(f"the program gave no answer within {limit_s:g} s")
            part = os.read(self._stdout, 4096)
            if not part:
                raise ChildProcessError(self._why_gone())
            self._rest += part
            if len(self._rest) > _LONGEST_ANSWER:
                raise ValueError(
                    f"the program answered a line of more than {_LONGEST_ANSWER} bytes"
                )
        line, _, self._rest = self._rest.partition(_NEWLINE)
        if self._rest:
            # The rest would be taken for the answer to the next observation.
            raise ValueError("the program answered more than one line")
        return line

    def end(self) -> None:
        """Kill the program."""
        self._process.kill()
        self._process.communicate()

    def _why_gone(self) -> str:
        try:
            code: int | str = self._process.wait(timeout=1.0)
        except subprocess.TimeoutExpired:
            code = "none yet"
        return f"the program ended (exit code {code})"


_programs: dict[tuple[str, ...], _Running] = {}
"""The running programs of this process, by their commands."""


def _running_program(command: tuple[str, ...]) -> _Running:
    if command not in _programs:
        _programs[command] = _Running(command)
    return _programs[command]


def _end(command: tuple[str, ...]) -> None:
    program = _programs.pop(command, None)
    if program is not None:
        program.end()


def line_of(observation: Observation) -> bytes:
    """The JSON line of an observation, with its line end."""
    ego = observation.ego
    moving = {
        "time_s": observation.time_s,
        "step_s": observation.step_s,
        "ego": ego._asdict(),
        "pedestrians": [
            {**person._asdict(), "side": person.side.value} for person in observation.pedestrians
        ],
    }
    # The constants are the same in every line, so their text is cached.
    constants = _constants(observation.vehicle, observation.crossing)
    return f"{json.dumps(moving)[:-1]}, {constants}}}\n".encode()


@lru_cache
def _constants(vehicle: Vehicle, crossing: Crossing) -> str:
    crosswalk = asdict(crossing) | {"stop_line_m": crossing.stop_line_m}
    return json.dumps({"vehicle": asdict(vehicle), "crossing": crosswalk})[1:-1]
