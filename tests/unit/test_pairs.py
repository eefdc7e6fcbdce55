"""Both arms of a pair meet the same pedestrians, whenever and wherever the pair is run."""

import math
import multiprocessing
from dataclasses import fields

import numpy as np
import pytest

from harness.core.seeding import stream
from harness.core.vocabulary import Arm
from harness.encounter.arms import arm_key, make_strategy
from harness.encounter.arrivals import planned_arrivals
from harness.measures import Outcome
from harness.model.interaction import InteractionModel, load_model
from harness.model.mixture.conditional import Conditional
from harness.scenario import Scenario, validate
from harness.strategies.human_yield import HumanYield
from tests.scenes import on_plain

FLOW: dict = {
    "pedestrians": {"flow_per_hour": 900.0},
    "strategies": {"human_gmm": {"speed": "sampled"}},
    "experiment": {"timeout_s": 120.0, "seed": 3},
}


def content(outcome: Outcome) -> tuple[object, ...]:
    """Everything of an outcome, as bytes where it is an array: equal means equal bits."""
    trace = outcome.trace
    return (
        outcome.pair,
        outcome.arm.value,
        outcome.strategy,
        tuple((f.name, repr(getattr(outcome.record, f.name))) for f in fields(outcome.record)),
        trace.x_m.tobytes(),
        trace.speed_mps.tobytes(),
        repr(trace.walks),
    )


def run(tree: dict[str, dict], pairs: list[int]) -> dict[int, list[tuple]]:
    """Contents by pair; a function of plain values, so that another process can call it."""
    found: dict[int, list[tuple]] = {}
    for outcome in on_plain(validate(tree, "test"), load_model("dut")).run(pairs):
        found.setdefault(outcome.pair, []).append(content(outcome))
    return found


def arms(scenario: Scenario, model: InteractionModel, pairs: int) -> list[tuple[Outcome, Outcome]]:
    outcomes = list(on_plain(scenario, model).run(range(pairs)))
    assert [o.arm for o in outcomes] == [Arm.AV, Arm.HUMAN] * pairs
    return list(zip(outcomes[::2], outcomes[1::2], strict=True))


def test_both_arms_meet_the_same_pedestrians(model) -> None:
    scenario = validate(FLOW, "test")
    for av, human in arms(scenario, model, 30):
        assert av.pair == human.pair
        planned = planned_arrivals(scenario, av.pair)
        for outcome in (av, human):
            came = tuple(walk.arrival for walk in outcome.trace.walks)
            assert came == planned[: len(came)]
            # Nobody who should have come while it lasted is missing.
            end = (len(outcome.trace.x_m) - 1) * scenario.experiment.step_s
            missing = [a.arrival_s for a in planned[len(came) :]]
            assert all(arrival > end - 1e-9 for arrival in missing)


def test_walking_speeds_come_from_each_arms_own_state(model) -> None:
    # The same quantile of f(v_p | 1/R, v) at what was seen: the CDF there gives it back.
    scenario = validate(FLOW, "test")
    conditional = Conditional(model.mixture, 2, (0, 1))
    differing = checked = 0
    for av, human in arms(scenario, model, 20):
        speeds: dict[int, list[float]] = {}
        for outcome in (av, human):
            for walk in outcome.trace.walks:
                if walk.start_s is None or not walk.range_m or walk.range_m <= 0:
                    continue
                assert walk.speed_mps is not None
                assert walk.vehicle_speed_mps is not None
                seen = np.array([[1 / walk.range_m, walk.vehicle_speed_mps]])
                seen = np.clip(seen, model.mixture.lower[:2], model.mixture.upper[:2])
                back = conditional.cdf(np.array([walk.speed_mps]), seen)[0]
                assert back == pytest.approx(walk.arrival.quantile, abs=1e-8)
                speeds.setdefault(walk.arrival.index, []).append(walk.speed_mps)
                checked += 1
        differing += sum(len(set(pair)) == 2 for pair in speeds.values())
    assert checked > 50
    assert differing > 10  # arms in different states give different speeds


@pytest.fixture(scope="module")
def in_order() -> dict[int, list[tuple]]:
    return run(FLOW, list(range(60)))


def test_a_pair_first_last_alone_or_in_another_process(in_order) -> None:
    assert run(FLOW, list(reversed(range(60)))) == in_order
    for pair in (0, 17, 59):
        assert run(FLOW, [pair])[pair] == in_order[pair]
    assert run(FLOW, [59, 3]) == {pair: in_order[pair] for pair in (59, 3)}
    context = multiprocessing.get_context("spawn")
    with context.Pool(1) as pool:
        elsewhere = pool.apply(run, (FLOW, [41, 2]))
    assert elsewhere == {pair: in_order[pair] for pair in (41, 2)}


def yielding(av: str, human: str, driver: Arm, model: InteractionModel) -> np.ndarray:
    """Whether a driver who is ``human_yield`` is one who yields (0.74 are), in each pair."""
    scenario = validate({"arms": {"av": av, "human": human}, "experiment": {"seed": 3}}, "test")
    drivers = [make_strategy(scenario, driver, pair, model) for pair in range(2000)]
    return np.array([one.yields for one in drivers if isinstance(one, HumanYield)])


def test_an_av_that_draws_gets_no_number_of_the_reference_unless_it_is_the_reference(model) -> None:
    human = yielding("hard_yield", "human_yield", Arm.HUMAN, model)
    # The reference draws from the stream that it always had, the AV from another: two that are
    # independent say the same in 0.74² + 0.26² of the pairs.
    assert (human == [stream(3, "strategy", pair).random() < 0.74 for pair in range(2000)]).all()
    av = yielding("human_yield", "hard_yield", Arm.AV, model)
    alike = 0.74**2 + 0.26**2
    assert (av == human).mean() == pytest.approx(alike, abs=4 * math.sqrt(alike * 0.24 / 2000))
    both = [yielding("human_yield", "human_yield", arm, model) for arm in Arm]
    assert (both[0] == both[1]).all()
    assert (both[0] == yielding("hard_yield", "human_yield", Arm.HUMAN, model)).all()


def test_cells_share_only_episodes_in_which_the_driver_draws_alike(model) -> None:
    """Of drivers who draw, those are alike whose strategy, parameters and stream are the same."""
    yields = {"av": "human_yield", "human": "human_yield"}
    first = validate({**FLOW, "arms": yields}, "")
    for arms in ({**yields, "human": "hard_yield"}, {**yields, "av": "hard_yield"}, yields):
        other = validate({**FLOW, "arms": arms}, "")
        of_both = [on_plain(each, model).run(range(20)) for each in (first, other)]
        for one, two in zip(*of_both, strict=True):
            alike = arm_key(first, one.arm) == arm_key(other, two.arm)
            assert not alike or content(one) == content(two)
        kept = [arm for arm in Arm if arm_key(first, arm) == arm_key(other, arm)]
        same = [*Arm] if arms == yields else [Arm.HUMAN] * (arms["human"] == "human_yield")
        assert kept == same
