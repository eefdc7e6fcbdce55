"""The one place that chooses where the tasks of a study run."""

from harness.scenario import Options, Study
from harness.store.kinds import kind_of_study
from harness.strategies.own import is_of_this_process
from harness.studies.workers.pool import LocalPool, workers_for
from harness.studies.workers.tasks import Executor


def executor_for(study: Study, options: Options, dask: str | None = None) -> Executor:
    """What runs the tasks of a study.

    Args:
        study: what is run.
        options: ``workers`` 0 is this process, as is a strategy that is a class of this script.
        dask: the address of a Dask scheduler; None: processes on this machine.

    Raises:
        InputError: see ``DaskCluster``.
    """
    if dask is not None:
        from harness.studies.workers.cluster import DaskCluster

        return DaskCluster(dask)
    if options.workers == 0 or any(map(is_of_this_process, study.driven)):
        from harness.studies.workers.this_process import ThisProcess

        return ThisProcess()
    pairs = sum(cell.scenario.experiment.pairs for cell in study.cells)
    # With few pairs, which may be quick, not all workers start at once.
    at_once = pairs if kind_of_study(study).long_pairs else -(-pairs // options.task_pairs)
    return LocalPool(workers_for(pairs, options), at_once=at_once)
