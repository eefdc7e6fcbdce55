"""``harness`` and ``python -m harness``."""

from harness.cli.interruption import leave_at_once


def main() -> None:
    """Run the command line; to be interrupted at any moment, its imports included."""
    leave_at_once()
    from harness.cli.app import main as run

    run()


if __name__ == "__main__":
    main()
