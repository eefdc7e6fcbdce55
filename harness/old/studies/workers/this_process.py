"""Runs tasks in this process, with its standard input and without time limits."""

from collections.abc import Callable
from concurrent.futures import Future

from harness.engine.shared import close_engine
from harness.old.studies.workers.executor import Argument, Result, TaskFailedError


class ThisProcess:
    """See ``Executor``.  ``breakpoint()`` works in a strategy.

    A strategy that kills its process kills this process, and a strategy that hangs is not ended.
    """

    workers = 1

    def submit(
        self, function: Callable[[Argument], Result], argument: Argument
    ) -> "Future[Result]":
        """See ``Executor.submit``."""
        future: Future[Result] = Future()
        try:
            future.set_result(function(argument))
        except Exception as error:
            what = f"{type(error).__name__}: {error}"
            future.set_exception(TaskFailedError(what))
        return future

    def stop(self) -> None:
        """See ``Executor.stop``."""
        close_engine()
