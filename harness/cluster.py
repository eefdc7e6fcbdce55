"""The same tasks on an existing Dask cluster (extra ``cluster``)."""

import logging
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from harness.errors import InputError
from harness.pool import LocalPool
from harness.tasks import Argument, ExecutorLostError, Result


class DaskCluster:
    """Submits tasks to a Dask scheduler; results come back as ordinary futures.

    Args:
        address: of the scheduler, e.g. ``tcp://127.0.0.1:8786``.

    Raises:
        InputError: the extra is not installed, nobody answers, there are no workers, or one has
            several threads (libsumo runs one simulation per process).
    """

    def __init__(self, address: str) -> None:
        where = f"--dask {address}"
        try:
            from distributed import Client
            from distributed.comm.addressing import get_address_host_port
        except ImportError:
            raise InputError(
                where, "Dask is not installed", "pip install crosswalk-harness[cluster]"
            ) from None
        # What they have to say of a lost scheduler is said here, in one line.
        for name in ("distributed", "distributed.client", "asyncio"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
        self._address = address
        try:
            # A client that cannot even read its address complains once more when it is deleted.
            get_address_host_port(address, strict=True)
            self._client = Client(address, timeout=10, set_as_default=False)
        except (OSError, ValueError) as error:
            raise InputError(where, f"no scheduler answers ({error})", "host:port of one") from None
        threads = self._client.nthreads()
        if not threads or any(count != 1 for count in threads.values()):
            found = ", ".join(str(count) for count in threads.values()) or "no workers"
            self._client.close()
            raise InputError(
                where, f"threads of its workers: {found}", "dask worker --nthreads 1 (one or more)"
            )
        self.workers = len(threads)

    def submit(
        self, function: Callable[[Argument], Result], argument: Argument
    ) -> "Future[Result]":
        """See ``Executor.submit``; Dask's own retries are off, so that culprits are counted."""
        lost = ExecutorLostError(f"the Dask cluster at {self._address} is gone")
        if self._client.status != "running":
            raise lost
        result: Future[Result] = Future()
        result.set_running_or_notify_cancel()
        # A retry is a new computation, not a look at the old one's failure: hence pure=False.
        remote = self._client.submit(call_apart, function, argument, pure=False, retries=0)

        def done(_finished: object) -> None:
            if remote.status in ("cancelled", "lost"):
                result.set_exception(lost)
                return
            try:
                result.set_result(remote.result())
            except BaseException as error:
                result.set_exception(error)

        remote.add_done_callback(done)
        return result

    def stop(self) -> None:
        """See ``Executor.stop``; the cluster itself goes on."""
        self._client.close()


_beside: LocalPool | None = None


def call_apart(function: Callable[[Any], Any], argument: Any) -> Any:
    """Call in a process beside this Dask worker's own.

    A task that dies then costs the cluster no worker.  Dask would hand it to another one, four in
    all, and suspect whatever else they were about to do.
    """
    global _beside
    if _beside is None:
        _beside = LocalPool(1)
    return _beside.submit(function, argument).result()
