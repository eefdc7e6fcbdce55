"""What a worker process begins with: its parent's end is its own.

Imports next to nothing, to be in force while the worker still imports the rest.
"""

import os
from threading import Thread


def end_with_parent() -> None:
    """Nobody would read what a worker without a parent finds out: standard input ends then."""
    Thread(target=_wait_and_exit, daemon=True).start()


def _wait_and_exit() -> None:
    try:
        while os.read(0, 1):
            pass
    finally:
        os._exit(1)
