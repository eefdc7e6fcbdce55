"""The application: every command, and how refusals and interruptions end it."""

import sys

import typer
from typer.exceptions import Abort, Exit, TyperException

from harness.cli import about, batch, model, reporting, review
from harness.cli.output import say
from harness.errors import HarnessError, InputError, InterruptedRunError

COMMANDS = (
    batch.run,
    batch.sweep,
    reporting.report,
    review.replay,
    review.score,
    review.compare,
    review.export,
    about.network,
    about.strategies,
    about.doctor,
    model.extract,
    model.fit,
)
"""In the order in which ``harness --help`` lists them; ``model show`` is a group of its own."""

app = typer.Typer(
    name="harness",
    help="Judge an automated vehicle's strategy at an unsignalized crosswalk, in SUMO, against a "
    "human driver who meets the same pedestrians.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for command in COMMANDS:
    app.command()(command)
app.add_typer(model.group, name="model")


_INTERRUPTED = 130
"""Exit code of Ctrl-C; typer returns it where a command did not catch the interruption."""


def main() -> None:
    """Run the command line; every refusal becomes one line on stderr and exit code 2."""
    try:
        code = app(standalone_mode=False)
        if code == _INTERRUPTED:
            say("harness: interrupted")
    except (InputError, TyperException) as error:
        text = error.format_message() if isinstance(error, TyperException) else str(error)
        # `harness` or `harness model` alone: typer's answer is the whole help.
        say(text if text.startswith("Usage:") else "harness: " + " ".join(text.split()))
        code = 2
    except InterruptedRunError as error:
        say(f"harness: {error}")
        code = _INTERRUPTED
    except HarnessError as error:
        say(f"harness: {error}")
        code = 1
    except OSError as error:
        # What no module foresaw: a name too long for the file system, a disk that went away.
        name = "" if error.filename is None else f"{error.filename}: "
        say(f"harness: {name}{error.strerror or error}")
        code = 1
    except Exit as error:
        code = error.exit_code
    except (Abort, KeyboardInterrupt):
        say("harness: interrupted")
        code = _INTERRUPTED
    sys.exit(code if isinstance(code, int) else 0)
