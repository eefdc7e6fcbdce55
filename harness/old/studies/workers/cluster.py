"""Takes tasks and runs them on an existing Dask cluster (extra ``cluster``)."""

import logging
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from zipfile import ZipFile

from harness.core.errors import InputError
from harness.old.studies.kinds.tasks import Task
from harness.old.studies.workers.executor import Argument, ExecutorLostError, Result
from harness.old.studies.workers.pool import LocalPool
from harness.old.studies.workers.upload import archive_of, top_modules


class DaskCluster:
    """Submits tasks to a Dask scheduler and returns ordinary futures.

    Args:
        address: address of the scheduler, e.g. ``tcp://127.0.0.1:8786``.

    Raises:
        InputError: the extra is not installed, the scheduler does not answer, there is no worker,
            or a worker has several threads (libsumo runs one simulation per process).
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
        # The harness reports a lost scheduler in one line, so Dask's own messages are suppressed.
        for name in ("distributed", "distributed.client", "asyncio"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
        self._address = address
        try:
            # A client with an invalid address would print a second error when it is deleted.
            get_address_host_port(address, strict=True)
            self._client = Client(address, timeout=10, set_as_default=False)
        except (OSError, ValueError) as error:
            allowed = "host:port of a running Dask scheduler"
            raise InputError(where, f"no scheduler answers ({error})", allowed) from None
        threads = self._client.nthreads()
        if not threads or any(count != 1 for count in threads.values()):
            counts = ", ".join(str(count) for count in threads.values()) or "no workers"
            self._client.close()
            raise InputError(
                where, f"threads of its workers: {counts}", "dask worker --nthreads 1 (one or more)"
            )
        self.workers = len(threads)
        self._modules: frozenset[str] = frozenset()
        self._archive: str | None = None

    def submit(
        self, function: Callable[[Argument], Result], argument: Argument
    ) -> "Future[Result]":
        """See ``Executor.submit``.  Dask does not retry, because the harness counts failures."""
        lost = ExecutorLostError(f"the Dask cluster at {self._address} is gone")
        if self._client.status != "running":
            raise lost
        result: Future[Result] = Future()
        result.set_running_or_notify_cancel()
        # With pure=True a retry would return the failure of the first call.
        remote = self._client.submit(
            call_apart, function, argument, self._uploaded(argument), pure=False, retries=0
        )

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
        """See ``Executor.stop``; the cluster itself keeps running."""
        self._client.close()

    def _uploaded(self, argument: object) -> str | None:
        """Upload the user's strategies of a task to every worker; return the archive's name."""
        if not isinstance(argument, Task):
            return None
        modules = self._modules | top_modules(argument.scenario.arms.model_dump().values())
        if modules != self._modules:
            archive = archive_of(modules)
            if archive is not None:
                with TemporaryDirectory(prefix="crosswalk-harness-") as folder:
                    file = Path(folder) / archive.name
                    file.write_bytes(archive.content)
                    # Workers that join later get it too.  The Dask worker does not import it.
                    self._client.upload_file(str(file), load=False)
                self._archive = archive.name
            self._modules = modules
        return self._archive


_apart: tuple[str | None, LocalPool] | None = None


def call_apart(function: Callable[[Any], Any], argument: Any, archive: str | None) -> Any:
    """Call a function in another process than the Dask worker.

    A task that kills its process then does not kill a worker of the cluster.  Otherwise Dask would
    give such a task to up to four workers and blame the other tasks of these workers too.

    Args:
        function: see ``Executor.submit``.
        argument: see ``Executor.submit``.
        archive: the uploaded file with the user's strategies.  A new archive starts a new process,
            so that modules of an earlier run are not used again.
    """
    global _apart
    if _apart is not None and _apart[0] != archive:
        _apart[1].stop()
        _apart = None
    if _apart is None:
        _apart = (archive, LocalPool(1, None if archive is None else _unpacked(archive)))
    return _apart[1].submit(function, argument).result()


def _unpacked(archive: str) -> Path:
    """Unpack an uploaded archive and return its folder."""
    from distributed import get_worker

    file = Path(get_worker().local_directory) / archive
    folder = file.with_suffix("")
    # The name contains a digest of the content, so files from an earlier run are identical.
    with ZipFile(file) as content:
        content.extractall(folder)
    return folder
