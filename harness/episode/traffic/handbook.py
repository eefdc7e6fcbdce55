"""A scenario and its flows in; the pedestrian delay by HCM 2010 and NCHRP 17-87 out."""

import math
from dataclasses import dataclass
from typing import Any

from harness.episode.traffic.closed_forms import (
    critical_headway_s,
    group_headway_s,
    hcm_delay_s,
    revised_hcm_delay_s,
)
from harness.episode.traffic.lanes import lanes_of
from harness.scenario import Scenario
from harness.strategies.human_yield import HumanYield
from harness.strategies.parameters import parameters_of
from harness.strategies.registry import find_strategy
from harness.strategies.yield_rates import rate_of


@dataclass(frozen=True, slots=True)
class Handbook:
    """Mean delays of pedestrians by HCM 2010 and NCHRP 17-87; ``reason`` says why they are None."""

    yield_rate: float | None = None
    hcm_s: float | None = None
    nchrp_s: float | None = None
    reason: str | None = None


def handbook(
    scenario: Scenario,
    av_share: float,
    vehicles_per_s: float,
    pedestrians_per_s: float,
    walking_mps: float | None,
) -> Handbook:
    """The handbooks' delays with t_c = L/S_p, t_s = 0 and the strategies' declared yield rates.

    Args:
        scenario: the cell's scenario.
        av_share: share of vehicles that ``arms.av`` drives; 0 in the reference's arm.
        vehicles_per_s: v, the simulated flow of vehicles.
        pedestrians_per_s: v_p, the simulated flow of pedestrians.
        walking_mps: S_p, the pedestrians' mean walking speed.
    """
    rate = 0.0
    for name, share in ((scenario.arms.av, av_share), (scenario.arms.human, 1 - av_share)):
        declared = _declared_rate(scenario, name) if share > 0 else 0.0
        if declared is None:
            return Handbook(reason=f"{name} declares no yield rate")
        rate += share * declared
    if scenario.known_traffic.saturated:
        return Handbook(rate, reason="a permanent queue")
    if scenario.flows_change:
        return Handbook(rate, reason="flows that change")
    if len(scenario.pedestrians.group_size) > 1:
        return Handbook(rate, reason="people come in groups")
    if vehicles_per_s == 0 or walking_mps is None:
        return Handbook(rate, reason="nobody met")
    crossing = scenario.crosswalk()
    headway_s = critical_headway_s(crossing.length_m, walking_mps, 0.0)
    group_s = group_headway_s(vehicles_per_s, pedestrians_per_s, headway_s, crossing.width_m)
    lanes = len(lanes_of(scenario))
    hcm_s = hcm_delay_s(vehicles_per_s, group_s, lanes, rate)
    nchrp_s = revised_hcm_delay_s(vehicles_per_s, group_s, lanes, rate)
    if not (math.isfinite(hcm_s) and math.isfinite(nchrp_s)):
        return Handbook(rate, reason="infinite")
    return Handbook(rate, hcm_s, nchrp_s)


def _declared_rate(scenario: Scenario, name: str) -> float | None:
    """The parameter ``yield_rate`` of a strategy, or its treatment's rate; None if it has none."""
    strategy = find_strategy(name, "arms")
    given: dict[str, Any] = scenario.strategies.get(name, {})
    if strategy is HumanYield and "treatment" in given:
        return rate_of(given["treatment"], f"{name}.treatment")
    rates = {p.name: p.default for p in parameters_of(strategy)} | given
    return rates.get("yield_rate")
