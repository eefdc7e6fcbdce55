"""The application: all commands, and the exit codes of refusals and interruptions."""

import errno
import io
import sys
import traceback
from typing import Annotated

import typer
from typer.exceptions import Abort, Exit, TyperException

from harness.cli import about, encounters, folders
from harness.cli.interruption import LINE, BrokenOffError, exit_code
from harness.cli.output import say
from harness.core.errors import HarnessError, InputError, one_line
from harness.old.cli import conflicts, crossings, model, risk, validation

app = typer.Typer(
    name="harness",
    help="Judge an automated vehicle's strategy at an unsignalized crosswalk, in SUMO, against a "
    "human driver who meets the same pedestrians.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


@app.callback()
def _harness(
    _version: Annotated[
        bool,
        typer.Option(
            "--version", callback=about.print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
) -> None:
    """Take the options that do not belong to a command."""


app.command()(encounters.run)
app.command("sweep", help="Another name for `harness run`.")(encounters.run)
for command in (
    encounters.resume,
    folders.show,
    folders.report,
    folders.compare,
    folders.worst,
    folders.replay,
    folders.export,
    risk.risk,
    about.network,
    crossings.crossings,
    conflicts.conflicts,
    about.strategies,
    about.doctor,
    model.extract,
    model.fit,
    validation.validate,
):
    app.command()(command)
app.add_typer(model.group, name="model")


_INTERRUPTED = 130
"""typer's exit code if a command did not catch the interruption."""

_NO_NAME = (errno.ENAMETOOLONG, errno.ELOOP, errno.ENOTDIR, errno.EINVAL)
"""Errors caused by a name that the user chose, not by the state of the file system."""

_OURS = (
    "harness: this is a bug in the harness, not an error in your files; please report the command "
    "and the lines above"
)


def main() -> None:
    """Run the command line; every refusal becomes one line on stderr and exit code 2."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        # Text that the terminal cannot encode, such as μ, must not end the command.
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        code = app(standalone_mode=False)
        if code == _INTERRUPTED:
            raise KeyboardInterrupt
    except (InputError, TyperException) as error:
        text = error.format_message() if isinstance(error, TyperException) else str(error)
        text = text.replace("Value error, ", "")  # from pydantic, with which typer checks choices
        # For `harness` or `harness model` alone typer answers with the whole help.
        say(text if text.startswith("Usage:") else one_line(f"harness: {text}"))
        code = 2
    except BrokenOffError as error:
        say(one_line(f"harness: {error}"))
        code = exit_code()
    except HarnessError as error:
        say(one_line(f"harness: {error}"))
        code = 1
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
    except MemoryError:
        say("harness: there is not enough memory for this")
        code = 1
    except Exception:
        # Files and options are checked when they are read, so any other error is a bug.
        traceback.print_exc()
        say(_OURS)
        code = 1
    sys.exit(code if isinstance(code, int) else 0)
