"""A program of the user, such as ``exec:./my_driver``, in; a strategy that asks it out.

The program reads one JSON line for each observation from its standard input and writes one number
to its standard output.  ``observation.schema.json`` beside this file defines the form of a line
(docs/strategies.md).
"""

import json
import os
import shlex
import subprocess
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar

from harness.core.errors import InputError, Place, reason_of
from harness.core.vocabulary import Crossing, Observation, StrategyFactory, Vehicle
from harness.scenario.consistency import PROGRAM

_NEWLINE = b"\n"
"""It ends every message."""
_LONGEST_ANSWER_BYTES = 1_000
"""No more of an answer is read; a number is shorter."""


def is_program(name: str) -> bool:
    """Whether a strategy's name stands for a program."""
    return name.startswith(PROGRAM)


def load_program(name: str, where: Place) -> StrategyFactory:
    """The strategy that a name such as ``exec:./my_driver --flag`` stands for.

    The program must lie in the working directory or below it, so that a scenario from somebody else
    can start only programs that you put there.

    Raises:
        InputError: the program does not exist, cannot be executed, or is a text without ``#!``.
    """
    return _program_below(Path.cwd().resolve(), name, where)


@lru_cache
def _program_below(here: Path, name: str, where: Place) -> StrategyFactory:
    """The strategy of a program below a folder; the same command is one class."""
    allowed = "exec:./PROGRAM ARGUMENTS, a program below the working directory"
    try:
        words = shlex.split(name.removeprefix(PROGRAM))
    except ValueError as error:
        raise InputError(where, f"{name!r} is not a command ({error})", allowed) from None
    if not words:
        raise InputError(where, f"{name!r} has no program", allowed)
    path = (here / words[0]).resolve()
    if not path.is_relative_to(here):
        raise InputError(where, f"{words[0]!r} is not below the working directory", allowed)
    if not path.is_file():
        raise InputError(where, f"there is no program {words[0]!r}", allowed)
    if not os.access(path, os.X_OK):
        raise InputError(where, f"{words[0]!r} cannot be executed", f"chmod +x {words[0]}")
    with path.open("rb") as file:
        head = file.read(_LONGEST_ANSWER_BYTES)
    if not head.startswith(b"#!") and b"\0" not in head:  # a compiled program has zeros
        first = "a first line such as #!/usr/bin/env python3"
        raise InputError(where, f"{words[0]!r} does not say what runs it", first)
    return type("Program", (ProgramDriver,), {"COMMAND": (str(path), *words[1:])})


class ProgramDriver:
    """An external program that reads a JSON line and answers with a commanded acceleration.

    Each worker starts it once and uses it for one episode after another; ``time_s = 0`` begins a
    new episode.  It must end when its standard input ends.  After a wrong answer it is ended, and
    the next episode starts it again.
    """

    COMMAND: ClassVar[tuple[str, ...]] = ()

    def decide(self, observation: Observation, /) -> Any:
        """The program's answer in m/s²."""
        answer = b""
        try:
            answer = _ask(_running_program(self.COMMAND), line_of(observation))
            if not answer.endswith(_NEWLINE):
                raise ValueError(answer)
            return json.loads(answer)
        except ValueError:
            close_programs(self.COMMAND)
            problem = f"the program answered {answer[:80]!r}, which is not one line with a number"
            raise ValueError(problem) from None
        except BaseException:
            close_programs(self.COMMAND)
            raise


def _ask(program: subprocess.Popen[bytes], line: bytes) -> bytes:
    """What a program answers to a line; a second line in it makes it no JSON."""
    assert program.stdin is not None
    assert program.stdout is not None
    answer = b""
    try:
        program.stdin.write(line)
        program.stdin.flush()
        while _NEWLINE not in answer and len(answer) < _LONGEST_ANSWER_BYTES:
            part = os.read(program.stdout.fileno(), _LONGEST_ANSWER_BYTES)
            if not part:
                raise BrokenPipeError
            answer += part
    except BrokenPipeError:
        program.kill()
        code = program.wait()
        raise ChildProcessError(f"the program ended (exit code {code})") from None
    return answer


_programs: dict[tuple[str, ...], subprocess.Popen[bytes]] = {}
"""The running programs of this process, by their commands."""


def _running_program(command: tuple[str, ...]) -> subprocess.Popen[bytes]:
    if command not in _programs:
        pipe = subprocess.PIPE
        try:
            _programs[command] = subprocess.Popen(command, stdin=pipe, stdout=pipe)
        except OSError as error:
            why = f"the program cannot be started ({reason_of(error)})"
            raise ChildProcessError(f"{why}: does what its #! names exist?") from None
    return _programs[command]


def close_programs(*commands: tuple[str, ...]) -> int:
    """End the running programs of these commands, or all of this process; return their number."""
    ended = [_programs.pop(each) for each in commands or [*_programs] if each in _programs]
    for program in ended:
        program.kill()
        program.communicate()
    return len(ended)


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
