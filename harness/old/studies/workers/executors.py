"""Chooses the executor for the tasks of a study."""

from harness.old.studies.workers.executor import Executor
from harness.old.studies.workers.pool import LocalPool, workers_for
from harness.scenario import Options, Study
from harness.strategies.own import is_of_this_process


def executor_for(study: Study, options: Options, dask: str | None = None) -> Executor:
    """Return the executor for the tasks of a study.

    Tasks run in this process if ``options.workers`` is 0, or if a strategy is a class of the
    running script.

    Args:
        study: the study.
        options: give the number of workers.
        dask: address of a Dask scheduler; None means processes on this machine.

    Raises:
        InputError: see ``DaskCluster``.
    """
    if dask is not None:
        from harness.old.studies.workers.cluster import DaskCluster

        return DaskCluster(dask)
    if options.workers == 0 or any(map(is_of_this_process, study.driven)):
        from harness.old.studies.workers.this_process import ThisProcess

        return ThisProcess()
    pairs = sum(cell.scenario.experiment.pairs for cell in study.cells)
    return LocalPool(workers_for(pairs, options))
