"""The same tasks on an existing Dask cluster (extra ``cluster``)."""

import logging
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from zipfile import ZipFile

from harness.core.errors import InputError
from harness.studies.workers.pool import LocalPool
from harness.studies.workers.tasks import Argument, ExecutorLostError, Result, Task
from harness.studies.workers.upload import archive_of, top_modules


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
        self._modules: frozenset[str] = frozenset()
        self._archive: str | None = None

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
        """See ``Executor.stop``; the cluster itself goes on."""
        self._client.close()

    def _uploaded(self, argument: object) -> str | None:
        """The archive with a task's own strategies, once every worker has it."""
        if not isinstance(argument, Task):
            return None
        modules = self._modules | top_modules(argument.scenario.arms.model_dump().values())
        if modules != self._modules:
            archive = archive_of(modules)
            if archive is not None:
                with TemporaryDirectory(prefix="crosswalk-harness-") as folder:
                    file = Path(folder) / archive.name
                    file.write_bytes(archive.content)
                    # Workers that join later get it too.  Nothing is imported in their own process.
                    self._client.upload_file(str(file), load=False)
                self._archive = archive.name
            self._modules = modules
        return self._archive


_beside: tuple[str | None, LocalPool] | None = None


def call_apart(function: Callable[[Any], Any], argument: Any, archive: str | None) -> Any:
    """Call in a process beside this Dask worker's own.

    A task that dies then costs the cluster no worker.  Dask would hand it to another one, four in
    all, and suspect whatever else they were about to do.

    Args:
        function: see ``Executor.submit``.
        argument: see there.
        archive: the uploaded file with the user's own strategies; another one means another
            process, so that no module of an earlier run is used again.
    """
    global _beside
    if _beside is not None and _beside[0] != archive:
        _beside[1].stop()
        _beside = None
    if _beside is None:
        _beside = (archive, LocalPool(1, None if archive is None else _unpacked(archive)))
    return _beside[1].submit(function, argument).result()


def _unpacked(archive: str) -> Path:
    """The folder with the content of an uploaded archive."""
    from distributed import get_worker

    file = Path(get_worker().local_directory) / archive
    folder = file.with_suffix("")
    # The name stands for the content: what is there from an earlier run is the same.
    with ZipFile(file) as content:
        content.extractall(folder)
    return folder
