"""What a run changed in the options of a user's SUMO configuration, in words."""

from pathlib import Path

from harness.engine.simulation.outputs import output_options
from harness.engine.simulation.running import ALWAYS, changed_options
from harness.scenario import Scenario
from harness.scenario.own_simulation import sumo_seed
from harness.site.configuration import SumoConfig

_Changes = dict[str, tuple[str | None, str | None]]


def changes_in_brief(scenario: Scenario) -> str:
    """Return the changes that matter to results, and the number of outputs that are not kept."""
    config, changes = _changes(scenario)
    written = output_options(config)
    seed = scenario.experiment.seed
    parts = [f"the seed ({'yours + pair' if seed == 1 else f'by yours, seed {seed} and pair'})"]
    if step := changes.get("step-length"):
        parts.append(f"the step ({float(step[1] or 0):g} s, yours {config.step_s:g} s)")
    other = [name for name in changes if name not in {*ALWAYS, *written, *_TOLD}]
    if (random := changes.get("random")) and random[0] is not None:
        other.append("random")
    parts += other
    if lost := sum(ours is None for name, (_, ours) in changes.items() if name in written):
        parts.append(f"{lost} output{'s' * (lost > 1)} not kept")
    return f"SUMO ran with your options but for {', '.join(parts)}."


_TOLD = ("seed", "step-length", "tripinfo-output", "device.ssm.file")


def changes_in_full(scenario: Scenario) -> str:
    """Return every changed option, with the user's value in brackets."""
    _, changes = _changes(scenario)
    words = (
        f"{name} {'left out' if ours is None else ours} ({'not given' if hers is None else hers})"
        for name, (hers, ours) in changes.items()
    )
    name = Path(scenario.known_simulation.config).name
    return f"SUMO ran with the options of {name}, except (yours in brackets): {'; '.join(words)}."


def _changes(scenario: Scenario) -> tuple[SumoConfig, _Changes]:
    simulation = scenario.known_simulation
    assert simulation.read is not None
    config = SumoConfig(Path(simulation.config), simulation.read.options)
    kept, first = frozenset(simulation.outputs), sumo_seed(scenario, config)
    return config, changed_options(config, kept, first, simulation.step_s)
