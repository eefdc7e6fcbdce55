"""Ends a worker process when its parent ends.

This module imports almost nothing, so that it works while the worker imports other modules.
"""

import os
from threading import Thread


def end_with_parent() -> None:
    """Exit when standard input ends, which happens when the parent process ends."""
    Thread(target=_wait_and_exit, daemon=True).start()


def _wait_and_exit() -> None:
    try:
        while os.read(0, 1):
            pass
    finally:
        os._exit(1)
