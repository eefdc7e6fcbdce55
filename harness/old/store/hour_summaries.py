"""The findings of a cell of hours as records, for the views that read attributes."""

from dataclasses import dataclass

from harness.core.encounter import Arm
from harness.encounter.traffic.saturation import Growth
from harness.old.statistics import Findings, Interval, Proportion
from harness.old.store.hour_catalogue import HOURS

_ENDS = {Arm.AV: "", Arm.HUMAN: "_human"}
_TRIPLES = [entry.names for entry in HOURS if entry.of_arm and entry.paired]


@dataclass(frozen=True, slots=True)
class ArmOfHours:
    """The results of one arm apart from its measures."""

    not_through: int
    never_went: int
    unreached: int
    conflicts_unreached: int
    growth: Growth
    saturated: bool
    rising_s: Interval
    kappa: Proportion
    fallback: Proportion
    los_vehicles: str | None
    los_pedestrians: str | None


@dataclass(frozen=True, slots=True)
class HoursSummary:
    """A cell: each measure in both arms and its difference, AV − reference."""

    pairs: int
    failed: int
    confidence: float
    time_ratio: Interval
    measures: dict[str, tuple[Interval, Interval, Interval]]
    arms: dict[Arm, ArmOfHours]


def hours_summary(findings: Findings) -> HoursSummary:
    """The findings of a cell as records."""

    def interval(name: str | None) -> Interval:
        finding = findings[name or ""]
        return Interval(finding.number, finding.low, finding.high)

    def share(name: str) -> Proportion:
        finding = findings[name]
        ends = (finding.number, finding.low, finding.high)
        return Proportion(*ends, finding.events or 0, finding.n or 0)

    def word(name: str) -> str | None:
        value = findings[name].value
        return None if value is None else str(value)

    arms = {
        arm: ArmOfHours(
            not_through=findings[f"not_through{end}"].count,
            never_went=findings[f"never_went{end}"].count,
            unreached=findings[f"unreached{end}"].count,
            conflicts_unreached=findings[f"conflicts_unreached{end}"].count,
            growth=Growth(findings[f"growth{end}"].number, findings[f"growth_bound{end}"].number),
            saturated=bool(findings[f"saturated{end}"].value),
            rising_s=interval(f"rising_s{end}"),
            kappa=share(f"kappa{end}"),
            fallback=share(f"fallback_share{end}"),
            los_vehicles=word(f"los_vehicles{end}"),
            los_pedestrians=word(f"los_pedestrians{end}"),
        )
        for arm, end in _ENDS.items()
    }
    measures = {
        str(av): (interval(av), interval(human), interval(paired)) for av, human, paired in _TRIPLES
    }
    return HoursSummary(
        findings["pairs"].count,
        findings["failed"].count,
        findings["confidence"].number or 0.0,
        interval("time_ratio"),
        measures,
        arms,
    )
