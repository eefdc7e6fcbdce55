"""Many candidates on the same people: the numbers of a run, references kept, workers that end."""

import numpy as np
import pandas as pd
import pytest

import harness
from harness.core.errors import InputError
from harness.old.studies.candidates import evaluation
from harness.old.studies.candidates.evaluation import WALL_TIMES, evaluate, file_of, scenarios_of
from harness.old.studies.candidates.session import Session
from tests.faulty import NAME as FAULTY, struck

GAP = "strategies.gap_yield.critical_gap_s"
YIELDS = {"arms.av": "gap_yield", "experiment.pairs": 30}
CANDIDATES = [{GAP: np.float64(0.5)}, {GAP: np.int64(3)}, {"ego.resume_acceleration_mps2": 2.0}]


@pytest.fixture(autouse=True)
def _own_sessions(monkeypatch):
    sessions: dict = {}
    monkeypatch.setattr(evaluation, "_sessions", sessions)
    yield
    for session in sessions.values():
        session.close()


@pytest.mark.parametrize("engine", ["plain", "sumo"])
def test_the_numbers_are_those_of_a_run_of_the_same_pairs(tmp_path, engine) -> None:
    """The run has both arms of a pair in one task; candidates have them in different calls."""
    chosen = CANDIDATES if engine == "plain" else CANDIDATES[:1]
    frame = evaluate(
        chosen, "cctc_flow", 30, settings=YIELDS, intervals=True, workers=0, engine=engine
    )
    options = harness.Options(workers=0, engine=engine)
    for number, candidate in enumerate(chosen):
        file = harness.read_scenario_file("cctc_flow", YIELDS | candidate)
        run = harness.run_study(harness.study_of(file), options, out=tmp_path / str(number))
        expected = run.summary.iloc[0]
        for name in expected.index.intersection(frame.columns):
            both = expected[name], frame.loc[number, name]
            assert both[0] == both[1] or all(map(pd.isna, both)), name
    assert len(frame.columns.intersection(run.summary.columns)) > 100


def test_neither_order_nor_division_nor_other_candidates_change_a_row() -> None:
    def rows(candidates, pairs=30, workers=0):
        frame = evaluate(
            candidates, "cctc_flow", pairs, settings=YIELDS, workers=workers, engine="plain"
        )
        return frame.drop(columns=list(WALL_TIMES))

    whole = rows(CANDIDATES)
    turned = rows(CANDIDATES[::-1], workers=2)
    pd.testing.assert_frame_equal(whole, turned[whole.columns].iloc[::-1].reset_index(drop=True))
    assert whole["delay_s"].nunique() == len(CANDIDATES)


def test_the_reference_is_driven_once_for_everything_it_does_not_depend_on() -> None:
    with Session(0, "plain") as session:

        def driven(candidate: dict, pairs: range) -> int:
            before = session.references
            # As settings, because candidates cannot have the seed.
            file = file_of("cctc_flow", YIELDS | candidate)
            session.drive(scenarios_of(file, [{}], pairs), pairs)
            return session.references - before

        assert driven({}, range(4)) == 4
        for same in (
            {GAP: 1.0},
            {"arms.av": "soft_yield"},
            {"perception.latency_s": 0.3},
            {"actuation.dead_time_s": 0.2, "actuation.lag_s": 0.3, "actuation.max_jerk_mps3": 20.0},
        ):
            assert driven(same, range(4)) == 0, same
        assert driven({"conflicts.pet_s": 2.0}, range(2, 6)) == 2
        for other in (
            {"experiment.seed": 2},
            {"arms.human": "human_yield"},
            {"perception.latency_s": 0.3, "perception.human": True},
            {"actuation.lag_s": 0.3, "actuation.human": True},
            {"actuation.lag_s": 0.4, "actuation.human": True},
            {"crossing.friction": 0.3},
            {"pedestrians.kerb_wait_s": 1.0},
        ):
            assert driven(other, range(4)) == 4, other


def test_the_workers_stay_open_and_end_with_the_session() -> None:
    session = Session(1, "plain")
    scenarios = scenarios_of(file_of("cctc_flow", YIELDS), [{}], range(2))
    session.drive(scenarios, range(2))
    (process,) = session._executor._alive
    session.drive(scenarios, range(2))
    assert session._executor._alive == {process}
    session.close()
    assert process.poll() is not None


def test_an_interruption_ends_the_workers_and_the_next_call_starts_new_ones(monkeypatch) -> None:
    scenarios = scenarios_of(file_of("cctc_flow", YIELDS), [{}], range(2))
    with Session(0, "plain") as session:

        def interrupted(*_args, **_kwargs):
            raise KeyboardInterrupt

        with monkeypatch.context() as patch:
            patch.setattr(session, "_driven", interrupted)
            with pytest.raises(KeyboardInterrupt):
                session.drive(scenarios, range(2))
        assert session._executor is None
        assert session.drive(scenarios, range(2))[0].rows.num_rows == 4


@pytest.mark.parametrize(
    ("candidates", "pairs", "words"),
    [
        ([{}, {"strategies.gap_yield.critical_gap": 1.0}], 3, "did you mean 'critical_gap_s'"),
        ([{"ego.initial_sped_mps": 1.0}], 3, "candidates[0] ego.initial_sped_mps"),
        ({GAP: 1.0}, 3, "a list of settings"),
        ([], 3, "at least one candidate"),
        ([{}], 0, "a whole number, 1 or more"),
        ([{}], range(5, 5), "a range of numbers"),
    ],
)
def test_bad_input_is_one_line(candidates, pairs, words) -> None:
    with pytest.raises(InputError) as refused:
        evaluate(candidates, "cctc_flow", pairs, settings=YIELDS, workers=0, engine="plain")
    assert words in str(refused.value)


def test_the_frame_has_the_first_failure_of_each_candidate() -> None:
    faulty = {"arms.av": FAULTY, **struck({"raises": 2, "nan": 3})}
    frame = evaluate([{}, faulty], "cctc_flow", 5, settings=YIELDS, workers=0, engine="plain")
    whole, failed = frame["failure"]
    assert pd.isna(whole)
    assert frame["failed_av"].tolist() == [0, 2]
    assert failed.startswith("pair 2 av: the strategy raised RuntimeError: on purpose at t = 0.3")


def test_hours_are_refused() -> None:
    with pytest.raises(InputError, match="a scenario of encounters"):
        evaluate([{}], "traffic", 1)


@pytest.mark.parametrize(
    ("candidate", "words"),
    [
        ({"strategies.gap_yield.critical_gap": 1}, "did you mean 'critical_gap_s'"),
        ({"arms.av": "sumo_driver"}, "drives only with [simulation]"),
        ({GAP: float("nan")}, "finite number"),
        ({1: 2}, "dotted keys"),
        ({"experiment.seed": 5}, "who meet the same people"),
        ({"experiment . pairs": 5}, "who meet the same people"),
        ({"experiment": {"decide_limit_s": 2.0}}, "who meet the same people"),
    ],
)
def test_a_refusal_has_the_number_of_the_candidate(candidate, words) -> None:
    with pytest.raises(InputError) as refused:
        evaluate([{}, candidate], "cctc_flow", 1, settings=YIELDS, workers=0, engine="plain")
    assert str(refused.value).startswith("candidates[1]")
    assert words in str(refused.value)


def test_a_truth_value_is_no_number_of_pairs() -> None:
    with pytest.raises(InputError, match="a whole number, 1 or more"):
        evaluate([{}], "cctc_flow", True, engine="plain", workers=0)
