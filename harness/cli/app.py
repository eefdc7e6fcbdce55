"""Arguments in; the command that they name is run, and its exit code is set."""

import errno
import io
import sys
import traceback
from collections.abc import Mapping, Sequence
from importlib import import_module
from types import MappingProxyType

import typer
from typer.exceptions import Abort, Exit, TyperException

from harness.cli.interruption import LINE, BrokenOffError, exit_code
from harness.cli.output import say
from harness.core.errors import HarnessError, InputError, Parameter, one_line

COMMANDS: Mapping[str, str] = MappingProxyType({
    command: module
    for module, commands in {
        "cli.runs": "run sweep resume risk",
        "cli.finished": "show report compare worst replay export",
        "cli.about": "network crossings strategies",
        "cli.model": "extract fit model validate",
    }.items()
    for command in commands.split()
})  # fmt: skip
"""The commands with their modules; only that of the command which is asked for is imported."""

_INTERRUPTED = 130
"""typer's exit code if a command did not catch the interruption."""

_NO_NAME = (errno.ENAMETOOLONG, errno.ELOOP, errno.ENOTDIR, errno.EINVAL)
"""Errors caused by a name that the user chose, not by the state of the file system."""

_HELP = (
    "Judge an automated vehicle's strategy at a crosswalk against a human driver, in SUMO. Both "
    "meet the same pedestrians. `harness --version` prints the version."
)

_OURS = (
    "harness: this is a bug in the harness, not an error in your files; please report the command "
    "and the lines above"
)


def application(arguments: Sequence[str] = ()) -> typer.Typer:
    """The commands, or the one of these arguments."""
    app = typer.Typer(
        name="harness",
        help=_HELP,
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
    )
    app.callback()(lambda: None)  # without it a single command would have no name
    name = arguments[0] if arguments else ""
    wanted = [name] if name in COMMANDS else COMMANDS
    for command in wanted:
        module = import_module(f"harness.{COMMANDS[command]}")
        app.command(command)(module.run if command == "sweep" else getattr(module, command))
    return app


def _options(app: typer.Typer) -> dict[str | None, str]:
    """The option of each parameter that an error of a function may name."""
    commands = typer.main.get_group(app).commands.values()
    return {each.name: each.opts[0] for command in commands for each in command.params}


def main() -> None:
    """Run the command line; every refusal becomes one line on stderr and exit code 2."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        # Text that the terminal cannot encode, such as μ, must not end the command.
        sys.stdout.reconfigure(errors="backslashreplace")
    app = application(sys.argv[1:])
    try:
        code = app(standalone_mode=False)
        if code == _INTERRUPTED:
            raise KeyboardInterrupt
    except InputError as error:
        given = error.place
        if isinstance(given, Parameter) and (option := _options(app).get(given.name)):
            error = error.at(given._replace(name=option))
        say(one_line(f"harness: {error}"))
        code = 2
    except TyperException as error:
        # Typer checks choices by pydantic, which puts words before what is wrong.
        for wrong in getattr(error.__cause__, "errors", tuple)():
            error.message = str(wrong.get("ctx", {}).get("error", wrong["msg"]))
        text = error.format_message()
        # For `harness` or `harness model` alone typer answers with the whole help.
        say(text if text.startswith("Usage:") else one_line(f"harness: {text}"))
        code = 2
    except HarnessError as error:
        say(one_line(f"harness: {error}"))
        code = exit_code() if isinstance(error, BrokenOffError) else 1
    except OSError as error:
        # No module handled it: the file name is impossible, or a disk has disappeared.
        name = "" if error.filename is None else f"{error.filename}: "
        say(one_line(f"harness: {name}{error.strerror or error}"))
        code = 2 if error.errno in _NO_NAME else 1
    except Exit as error:
        code = error.exit_code
    except (Abort, KeyboardInterrupt):
        say(LINE)
        code = exit_code()
    except Exception:
        # Files and options are checked when they are read, so any other error is a bug.
        traceback.print_exc()
        say(_OURS)
        code = 1
    sys.exit(code if isinstance(code, int) else 0)
