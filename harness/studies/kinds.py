"""What simulates a task, by the kind of its run."""

from harness.studies.tasks import Rows, Task, Tell


def run_task(task: Task, tell: Tell = lambda _episode, _steps: None) -> Rows:
    """Simulate a task; see ``encounters.run_task`` and ``simulations.run_task``."""
    if task.own is not None:
        return task.own.run(task, tell)
    # What a run does not simulate is not imported.
    if task.cells[0].scenario.kind == "encounters":
        from harness.studies import encounters

        return encounters.run_task(task, tell)
    from harness.studies import simulations

    return simulations.run_task(task, tell)
