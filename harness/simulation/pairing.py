"""Both arms of a pair: one configuration, run twice with one seed."""

from collections.abc import Callable, Mapping, Sized
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

from harness.core.encounter import Arm, StepMotion
from harness.core.errors import EngineError, StrategyError
from harness.engine.session import Module, Session
from harness.model.interaction import InteractionModel
from harness.simulation.arm import ArmOfPair, Log
from harness.simulation.counting import crosswalks, people, vehicles
from harness.simulation.files import TRIPS_FILE, Kept, write_config
from harness.simulation.passages import Columns, passages
from harness.simulation.setup import Setup


@dataclass(frozen=True, slots=True)
class Outcome:
    """One arm of a pair: its tables, or the reason why it failed.

    Attributes:
        pair, arm: which arm.
        passages, vehicles, people, crosswalks: the columns of its tables.
        counts: the numbers of its row of ``arms``.
        collisions: collider, victim, lane and position of vehicles that hit each other.
        reason, traceback: why it failed.
    """

    pair: int
    arm: Arm
    passages: Columns = field(default_factory=dict)
    vehicles: Columns = field(default_factory=dict)
    people: Columns = field(default_factory=dict)
    crosswalks: Columns = field(default_factory=dict)
    counts: Mapping[str, float] = field(default_factory=dict)
    collisions: tuple[tuple[str, str, str, float], ...] = ()
    reason: str | None = None
    traceback: str | None = None


def run_arm(
    setup: Setup,
    model: InteractionModel,
    pair: int,
    arm: Arm,
    folder: Path,
    outputs: frozenset[str] | None = None,
    module: Module = "libsumo",
    more: Mapping[str, str] = MappingProxyType({}),
    begins: Callable[[Sized | None], None] = lambda _steps: None,
) -> Outcome:
    """Simulate one arm of a pair; if a strategy fails in one vehicle, the whole arm fails.

    Args:
        setup: what all arms of the cell share.
        model: the interaction model.
        pair: index of the pair.
        arm: which arm.
        folder: the arm's folder, where its configuration and outputs lie.
        outputs: the outputs that are kept (``Kept``); None: those of the setup.
        module: where SUMO runs.
        more: further options of SUMO.
        begins: receives what grows with every step when the first step is about to begin, and None
            after the last one.
    """
    session: Session | None = None
    try:
        kept = Kept(folder, setup.outputs if outputs is None else outputs)
        config = write_config(setup.config, kept, setup.seed(pair), setup.step_s, more)
        session = Session(config, module=module)
        running = ArmOfPair(setup, session, pair, arm, model)
        begins(running)
        log = running.run()
        begins(None)
        length_s = session.step_s
        session.close()
        session = None
        return outcome(setup, pair, arm, log, folder, length_s)
    except EngineError as error:
        if isinstance(error, StrategyError):
            return Outcome(pair, arm, reason=str(error), traceback=error.traceback)
        return Outcome(pair, arm, reason=f"{setup.config.path.name}: {error}")
    finally:
        if session is not None:
            session.close()


def outcome(setup: Setup, pair: int, arm: Arm, log: Log, folder: Path, step_s: float) -> Outcome:
    """The tables of an arm whose simulation has ended."""
    counted = [each for each in log.passages if setup.counts(each.time_s[0] - each.trace_offset_s)]
    motion: StepMotion = "ballistic" if setup.config.ballistic else "euler"
    passed = passages(counted, log.people, setup.zones, step_s, motion)
    fronts_s: dict[str, list[float]] = {}
    for name, front_s in zip(passed.get("crosswalk", ()), passed.get("front_s", ()), strict=True):
        if front_s is not None:
            fronts_s.setdefault(name, []).append(front_s)
    for times in fronts_s.values():
        times.sort()
    walked = people(log, setup, fronts_s)
    own = walked.get("own", [])
    return Outcome(
        pair=pair,
        arm=arm,
        passages=passed,
        vehicles=vehicles(folder / TRIPS_FILE, log, setup),
        people=walked,
        crosswalks=crosswalks(log, setup),
        counts={
            "begin_s": setup.begin_s,
            "counted_s": min(setup.end_s, log.end_s) - setup.begin_s,
            "vehicle_collisions": len(log.collisions),
            "person_collisions": log.person_collisions.total(),
            "teleports": log.teleports,
            "emergency_stops": log.emergency_stops,
            "conditionings": log.conditionings,
            "clamped": log.clamped,
            "overlaps": sum(lane.startswith(":") for _, _, lane, _ in log.collisions),
            "harness_people": sum(own),
            "sumo_people": len(own) - sum(own),
        },
        collisions=tuple(log.collisions),
    )
