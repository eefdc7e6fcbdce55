"""The entry point of the command ``harness`` and of ``python -m harness``.

The first worker of a run or page starts before the command is read, unless ``--dask`` has workers.
"""

import os
import sys
from contextlib import suppress

from harness.cli.interruption import leave_at_once
from harness.core.errors import HarnessError


def main() -> None:
    """Run the command line; to be interrupted at any moment, its imports included."""
    leave_at_once()
    if sys.argv[1:] == ["--version"]:
        from importlib.metadata import version

        print(version("crosswalk-harness"))
        return
    # Other threads of NumPy's linear algebra spin while a process starts, and are never needed.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    local = not any(word.startswith(("--help", "--dask")) for word in sys.argv)
    if local and sys.argv[1:2] in (["run"], ["sweep"], ["report"]):
        from harness.studies.running.children import start_children

        # The first worker imports its modules while this process imports its own.
        with suppress(HarnessError):  # the command will say it
            start_children(1)
    from harness.cli.app import main as run

    run()


if __name__ == "__main__":
    main()
