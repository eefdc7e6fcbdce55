"""What is said of references that agree, and of those that do not."""

from types import SimpleNamespace
from typing import Any

import pytest

from harness.comparison import Interval
from harness.report.reference_words import known_disagreement, reference_lines, references_compared
from harness.scenario import load_scenario


def run_of(*found: tuple[float | None, float | None, float | None]) -> Any:
    """A run over references, with the ratio of times and its limits for each."""
    names = ("human_gmm", "human_recorded", "human_yield")
    results = [
        SimpleNamespace(
            summary=SimpleNamespace(time_ratio=Interval(*ratio)),
            cell=SimpleNamespace(scenario=load_scenario("cctc", {"arms.human": name})),
        )
        for name, ratio in zip(names, found, strict=False)
    ]
    return SimpleNamespace(varied_keys=["arms.human"], results=results)


@pytest.mark.parametrize(
    ("found", "said"),
    [
        (((0.8, 0.7, 0.9), (0.9, 0.8, 0.99)), "takes less time than each of the references"),
        (((1.2, 1.1, 1.3), (1.5, 1.4, 1.6)), "takes more time than each of the references"),
        (((1.0, 0.9, 1.1), (0.9, 0.7, 1.2)), "No reference tells whether"),
        (((0.8, 0.7, 0.9), (1.2, 1.1, 1.3)), "The references disagree"),
        # An interval that holds 1 says neither, and does not disagree with one that tells.
        (
            ((0.8, 0.7, 0.9), (0.9, 0.8, 1.01)),
            "takes less time than some of the references; of the others it is not told",
        ),
        (((0.8, 0.7, 0.9), (None, None, None)), "human_recorded undefined"),
    ],
)
def test_references_agree_where_their_intervals_lie_on_one_side(found: Any, said: str) -> None:
    (line,) = references_compared(run_of(*found))
    assert said in line


def test_cells_that_differ_in_more_are_not_compared() -> None:
    run = run_of((0.8, 0.7, 0.9), (1.2, 1.1, 1.3))
    run.varied_keys = ["arms.human", "arms.av"]
    assert references_compared(run) == []


def test_only_what_was_validated_is_said_of_a_reference() -> None:
    as_validated, changed, no_human = (
        load_scenario("cctc", {"arms.human": name, **more})
        for name, more in (
            ("human_recorded", {}),
            ("human_recorded", {"strategies.human_recorded.horizon_s": 1.0}),
            ("sumo_driver", {}),
        )
    )
    first, second, third = reference_lines([as_validated, changed, no_human, as_validated])
    # docs/validation.md: 85.7 % of the orders, 1.40 s, 9 of 34 passages.
    assert "right for 86 % of them and its pass time off by 1.4 s" in first
    assert "touched somebody in 9 passages" in first
    assert "with these parameters was not measured" in second
    assert "how human it is was not measured" in third


def test_where_another_reference_says_the_opposite_it_is_warned() -> None:
    def words(av: str, human: str, mu: float, file: str = "cctc", **more: object) -> str:
        driven = {"arms.av": av, "arms.human": human}
        return known_disagreement(load_scenario(file, {**driven, **more}), mu)

    assert "took less time than human_gmm in cctc" in words("hard_yield", "human_recorded", 1.2)
    assert words("constant_speed", "human_gmm", 0.8) == ""
    assert words("hard_yield", "sumo_driver", 0.8) == ""
    gap = ("gap_yield", "human_gmm", 0.9)
    thousand = {"pedestrians.flow_per_hour": 1000.0, "experiment.seed": 7}
    assert "in cctc_flow, 1,000 per hour" in words(*gap, "cctc_flow", **thousand)
    # docs/study.md has these alone: at another site, or with other parameters, nothing is known.
    assert words("hard_yield", "human_recorded", 1.2, "cctc_flow") == ""
    for other in (
        {"crossing.length_m": 12.0},
        {"ego.initial_speed_mps": 6.0},
        {"strategies.gap_yield.critical_gap_s": 1.0},
        {"pedestrians.flow_per_hour": 400.0},
        {"perception.dropout_probability": 0.1},
    ):
        assert words(*gap, "cctc_flow", **other) == "", other
