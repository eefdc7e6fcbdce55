"""The protocol of executors that run calls, and their errors."""

from collections.abc import Callable
from concurrent.futures import Future
from typing import Protocol, TypeVar

from harness.core.errors import HarnessError

Argument = TypeVar("Argument")
Result = TypeVar("Result")


class Executor(Protocol):
    """Runs each call in a process that the call may kill."""

    workers: int

    def submit(
        self, function: Callable[[Argument], Result], argument: Argument
    ) -> "Future[Result]":
        """Start a call; the future raises if the call raised or its worker died.

        Args:
            function: a function at the top level of a module, so that the worker can import it.
            argument: its argument, which must be picklable.
        """
        ...

    def stop(self) -> None:
        """End everything at once."""
        ...


class ExecutorLostError(HarnessError):
    """The executor is lost; no task caused the loss."""


class WorkerDiedError(HarnessError):
    """The process that ran a task has died."""


class TaskFailedError(HarnessError):
    """A task raised the exception in the message; its worker continues."""
