"""Processes for fits: they do not hear Ctrl-C, and end with the process that started them."""

import os
import signal
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context, resource_tracker
from multiprocessing.connection import Connection
from threading import Thread, current_thread, main_thread
from typing import Any


class _Processes(ProcessPoolExecutor):
    """Processes that do not hear Ctrl-C."""

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
    """Yield an executor of so many processes, which end at once on an exception; None for one."""
    if workers == 1:
        yield None
        return
    resource_tracker.ensure_running()  # it would unblock the signal
    context = get_context("spawn")
    theirs, ours = context.Pipe(duplex=False)
    with theirs, ours:
        pool = _Processes(workers, context, _end_with, (theirs,))
        try:
            yield pool
        except BaseException:
            ours.close()
            pool.shutdown(wait=False, cancel_futures=True)
            raise
        pool.shutdown()


def _end_with(pipe: Connection) -> None:
    """End this process when the other end of a pipe is closed, by its parent or with it."""

    def watch() -> None:
        pipe.poll(None)
        os._exit(1)

    Thread(target=watch, daemon=True).start()
