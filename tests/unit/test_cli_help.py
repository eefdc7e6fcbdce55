"""What the commands say of themselves: each has a summary, each option a word of help."""

import click
import pytest
import typer
from typer.main import get_command

from harness.cli.app import app
from harness.cli.output import print_line
from harness.core.resources import shipped_directory


def commands(group: click.Group, prefix: str = "") -> dict[str, click.Command]:
    """Every command by its full name."""
    found: dict[str, click.Command] = {}
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            found |= commands(command, f"{prefix}{name} ")  # type: ignore[arg-type]
        else:
            found[f"{prefix}{name}"] = command
    return found


ALL = commands(get_command(app))  # type: ignore[arg-type]


def silent(command: click.Command) -> list[str]:
    """Options and arguments without a word of help."""
    return [str(p.name) for p in command.params if not getattr(p, "help", None)]


@pytest.mark.parametrize("name", ALL)
def test_every_command_and_option_says_what_it_does(name: str) -> None:
    assert (ALL[name].help or "").strip().endswith(".")
    assert silent(ALL[name]) == []


def test_this_file_would_notice() -> None:
    mute = typer.Typer()

    @mute.command()
    def command(word: str) -> None:
        print_line(word)

    assert silent(get_command(mute)) == ["word"]


def test_the_help_of_run_names_every_shipped_scenario() -> None:
    (words,) = (getattr(of, "help", "") for of in ALL["run"].params if of.name == "scenario")
    for file in shipped_directory("scenarios").glob("*.toml"):
        assert file.stem in words
