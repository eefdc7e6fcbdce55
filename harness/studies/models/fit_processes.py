"""The processes in which a model is fitted."""

import os
import signal
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, get_context, parent_process, resource_tracker
from threading import Thread, current_thread, main_thread
from typing import Any


class _Processes(ProcessPoolExecutor):
    """Processes that do not hear Ctrl-C, and that end with this one."""

    def submit(self, fn: Any, /, *arguments: Any, **options: Any) -> "Future[Any]":
        """Submit a call; a process that starts here inherits the blocked signal.

        An interruption waits until it has started: half a start would print a traceback.
        """
        came: list[int] = []
        # Python handles signals in the main thread, and only there may their handlers be changed.
        numbers = (signal.SIGINT, signal.SIGTERM) if current_thread() is main_thread() else ()
        noting = [(of, signal.signal(of, lambda number, _: came.append(number))) for of in numbers]
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            return super().submit(fn, *arguments, **options)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
            for number, handler in noting:
                signal.signal(number, handler)
            if came:
                signal.raise_signal(came[0])


@contextmanager
def processes(workers: int) -> Iterator[Executor | None]:
    """Yield an executor of so many processes, which are killed on an exception; None for one."""
    if workers == 1:
        yield None
        return
    resource_tracker.ensure_running()  # it would unblock the signal
    pool = _Processes(workers, get_context("spawn"), _end_with_parent)
    try:
        yield pool
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        for child in active_children():
            child.kill()
        raise
    pool.shutdown()


def _end_with_parent() -> None:
    def watch() -> None:
        if (parent := parent_process()) is not None:
            parent.join()
        os._exit(1)

    Thread(target=watch, daemon=True).start()
