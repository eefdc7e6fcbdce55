"""Refits of a model to resampled vehicles, and pairs spread over them."""

import json
from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from scipy import integrate, optimize, stats

from harness.core.encounter import Arm
from harness.core.errors import InputError
from harness.engine.plain import PlainEngine
from harness.episode.pairing import PairRunner
from harness.model.interaction import load_model, write_model
from harness.model.mixture.fitting import fit_mixture
from harness.old.report.screens.comparison_tables import comparison_tables
from harness.old.report.screens.screen import Screen, screen_lines
from harness.old.statistics import ENCOUNTERS, Finding, OverModel, over_model
from harness.old.studies.batch.experiment import resume
from harness.old.studies.calibration import RefitSettings, make_refits, make_sample
from harness.old.studies.calibration.refits import drawn_weights
from harness.old.studies.runs.compare import compare
from harness.old.studies.runs.notes import model_notes
from harness.old.studies.runs.reported import reported
from harness.scenario import load_scenario
from tests.batches import (
    one_cell,
    one_process,
    printed,
    refusal,
    run_inline,
    run_stopped,
    sweep,
)
from tests.scenes import refuses
from tests.unit.test_calibration import made_up

SETTINGS = RefitSettings(6, seed=2, starts=1)


@pytest.fixture(scope="module")
def sample():
    return make_sample(made_up())


@pytest.fixture(scope="module")
def fitted(sample, tmp_path_factory):
    """A model with K = 1, and its refits, made by one process."""
    folder = tmp_path_factory.mktemp("refits")
    fit = fit_mixture(
        sample.data, 1, sample.lower, sample.upper, sample_weight=sample.weights, n_init=1, seed=1
    )
    model = write_model(folder / "m.json", fit.mixture, "m", {"weigh": "encounter"})
    return folder, model, make_refits(folder / "m.refits.json", model, sample, "0", SETTINGS)


def test_a_refit_is_the_fit_to_the_rows_of_the_drawn_vehicles(sample, fitted):
    _, model, file = fitted
    loaded = load_model("", str(fitted[0] / "m.json"), True).refits
    for number in (0, 5):
        weights = drawn_weights(sample, SETTINGS, number)
        times = np.round(weights / sample.weights).astype(int)
        # V − 1 = 11 of 12 vehicles with replacement; all 20 rows of a vehicle are drawn together.
        assert times.sum() == 11 * 20
        assert all(len({*times[sample.vehicle == vehicle]}) == 1 for vehicle in range(12))
        # Drawing a vehicle twice is repeating its rows.
        rows = np.repeat(sample.data, times, axis=0)
        again = fit_mixture(
            rows,
            1,
            sample.lower,
            sample.upper,
            sample_weight=np.repeat(sample.weights, times),
            n_init=1,
            seed=9,
        ).mixture
        np.testing.assert_allclose(
            loaded.models[number].mixture.locations, again.locations, rtol=1e-4
        )
    assert loaded.effective_vehicles == pytest.approx(12)
    assert file.model_sha256 == model.sha256


def test_interrupted_refits_go_on_and_do_not_depend_on_the_workers(sample, fitted, tmp_path):
    folder, model, file = fitted
    whole = (folder / "m.refits.json").read_bytes()
    path = tmp_path / "m.refits.json"
    some = file.model_copy(update={"refits": {n: file.refits[n] for n in ("4", "1")}})
    path.write_bytes(some.content())
    done = []
    make_refits(path, model, sample, "0", SETTINGS, 2, lambda now, _: done.append(now))
    assert done == [2, 3, 4, 5, 6]
    assert path.read_bytes() == whole
    # More refits keep the first ones; another seed makes all of them new.
    with one_process():
        more = make_refits(path, model, sample, "0", replace(SETTINGS, count=7))
        path.write_bytes(some.content())
        other = make_refits(path, model, sample, "0", replace(SETTINGS, count=5, seed=3))
    assert {n: more.refits[n] for n in file.refits} == file.refits
    assert not any(other.refits[n] == file.refits[n] for n in other.refits)


def test_files_of_refits_that_do_not_fit_are_refused(fitted, tmp_path):
    folder, _, file = fitted
    path, beside = tmp_path / "m.json", tmp_path / "m.refits.json"
    path.write_bytes((folder / "m.json").read_bytes())

    def load():
        load_model("", str(path), True)

    refuses("is missing, so model m has no refits", load)
    beside.write_bytes(file.model_copy(update={"wanted": 7}).content())
    refuses("has 6 of 7 refits", load)
    beside.write_bytes(file.model_copy(update={"model_sha256": "0" * 64}).content())
    refuses("has the refits of another model", load)
    document = json.loads(file.content())
    document["refits"]["3"]["scale_triangles"][0][0] = -1.0
    beside.write_text(json.dumps(document))
    refuses("m.refits.json", load)
    # Without them the model is as valid as before.
    assert load_model("", str(path)).refits is None


def test_shipped_refits_are_of_the_shipped_models():
    for name, components in (("dut", 3), ("dut-k10", 10)):
        model = load_model(name, None, True)
        assert len(model.refits.models) == 20
        assert {refit.mixture.weights.size for refit in model.refits.models} == {components}
        effective = model.provenance["effective_vehicles"]
        assert model.refits.effective_vehicles == pytest.approx(effective)


def test_both_arms_of_a_pair_use_the_pairs_refit_and_nothing_else(tmp_path):
    scenario = load_scenario("cctc", {"arms.av": "soft_yield"})
    model = load_model("dut", None, True)

    def outcomes(model, pairs):
        vehicle, step_s = scenario.vehicle(), scenario.experiment.step_s
        runner = PairRunner(scenario, model, lambda: PlainEngine(vehicle, step_s))
        return {(o.pair, o.arm): o.record.pass_time_s for o in runner.run(pairs)}

    pairs = [3, 25, 43]
    spread = outcomes(model, pairs)
    # The parent is the run of a model that is refit 3 or 5 alone: 25 = 20 + 5, 43 = 2 · 20 + 3.
    for number, mine in ((3, [3, 43]), (5, [25])):
        refit = model.refits.models[number]
        alone = write_model(tmp_path / "alone.json", refit.mixture, "alone", {})
        assert outcomes(alone, mine) == {key: of for key, of in spread.items() if key[0] in mine}
    assert outcomes(load_model("dut"), [3])[3, Arm.HUMAN] != spread[3, Arm.HUMAN]


def finding(theta, half, n=500):
    return Finding(theta, theta - half, theta + half, n)


def test_limits_and_share_of_known_cases():
    rng = np.random.default_rng(1)
    z = stats.norm.ppf(0.975)
    # Without error of the pairs and with many refits, B is known: Student's t of the vehicles.
    values = rng.normal(0.8, 0.05, 400)
    found = over_model(finding(0.8, 1e-9), [*values], 16.0)
    reach = stats.t.ppf(0.975, 15) * values.std(ddof=1) * np.sqrt(1 + 1 / 400)
    assert found.high - 0.8 == pytest.approx(reach, rel=0.01)
    assert found.share == pytest.approx(1.0)
    # The share's interval: F = total / (B + R C) on R − 1 degrees of freedom (Searle 1971).
    values = np.linspace(-1, 1, 20)
    total, pairs = values.var(ddof=1), 0.004
    found = over_model(finding(0.0, z * np.sqrt(pairs)), [*values], 16.0)
    for share, quantile in ((found.share_low, 0.975), (found.share_high, 0.025)):
        between = total * 19 / stats.chi2.ppf(quantile, 19) - 20 * pairs
        assert share == pytest.approx(between * 1.05 / (between * 1.05 + pairs))
    # Both errors together are at least as large as each: sums of independent errors.
    assert found.high > max(z * np.sqrt(pairs), stats.t.ppf(0.975, 15) * np.sqrt(total - 0.08))
    # A number that no refit changes keeps its interval, and says nothing of the model's share.
    same = over_model(Finding(0.0, 0.0, 0.007, 500, 0), [0.0] * 20, 16.0)
    assert (same.low, same.high, same.share, same.mostly_model) == (0.0, 0.007, None, False)
    assert over_model(finding(0.8, 0.1), [None] * 18 + [0.8, 0.7], 16.0).low is None


def test_the_models_error_with_few_refits_against_quadrature():
    # The docstring's posterior of √B with a uniform prior, integrated by SciPy, not on a grid.
    values, half, vehicles = [0.6, 0.7, 0.85, 0.8, 1.05], 0.06, 16
    within = 5 * (half / stats.norm.ppf(0.975)) ** 2
    total = np.var(values, ddof=1)

    def likelihood(root):
        spread = root**2 + within
        return stats.chi2.pdf(4 * total / spread, 4) / spread

    def beyond(reach):
        def part(root):
            return likelihood(root) * stats.t.sf(reach / (root * np.sqrt(1.2)), vehicles - 1)

        return integrate.quad(part, 0, np.inf)[0] / integrate.quad(likelihood, 0, np.inf)[0] - 0.025

    expected = np.hypot(half, optimize.brentq(beyond, 0.01, 9.0))
    found = over_model(finding(0.8, half), values, vehicles)
    assert found.high - 0.8 == pytest.approx(expected, rel=0.002)


CHANGES = {"experiment.pairs": 40, "model.over_refits": True}


def test_a_run_over_refits_is_kept_resumed_and_named(tmp_path):
    study = one_cell("cctc", CHANGES)
    run = run_inline(study, tmp_path / "a", engine="plain", traces=True)
    rows = (tmp_path / "a" / "over_model.csv").read_text().splitlines()
    ratio = run.over_model[0]["time_ratio"]
    usual = run.results[0].findings["time_ratio"]
    assert ratio.low < usual.low < usual.high < ratio.high
    assert any(row.startswith(f"0,time_ratio,{ratio.value},{ratio.low}") for row in rows)
    refits = run.manifest["simulated_with"]["models"][0]["refits"]
    assert refits["count"] == 20
    assert refits["sha256"] == load_model("dut", None, True).refits.sha256
    run_stopped(study, tmp_path / "b", 2, engine="plain", traces=True)
    resume(tmp_path / "b", workers=0)
    for name in ("episodes.parquet", "over_model.csv", "manifest.json"):
        assert (tmp_path / "b" / name).read_bytes() == (tmp_path / "a" / name).read_bytes()
    # Off, nothing of it is there.
    two = one_cell("cctc", {"experiment.pairs": 2})
    plain = run_inline(two, tmp_path / "d", engine="plain")
    assert not (tmp_path / "d" / "over_model.csv").exists()
    assert "refits" not in plain.manifest["simulated_with"]["models"][0]
    assert pq.read_schema(tmp_path / "d" / "summary.parquet").names == (
        pq.read_schema(tmp_path / "a" / "summary.parquet").names
    )


def test_strategies_are_compared_over_pairs_and_refits(tmp_path):
    study = sweep("cctc", CHANGES, "arms.av=soft_yield,gap_yield")
    run = run_inline(study, tmp_path / "a", engine="plain")
    (item,) = compare(run).groups[0].comparisons
    times = [run.episodes.query(f"cell == {cell} and arm == 'av'").delay_s for cell in (0, 1)]
    difference = times[0].to_numpy() - times[1].to_numpy()
    by_refit = [np.nanmean(difference[refit::20]) for refit in range(20)]
    usual, found = item.delay_difference_s, item.over_model["delay_difference_s"]
    effective = load_model("dut").provenance["effective_vehicles"]
    expected = over_model(
        Finding(usual.value, usual.low, usual.high, usual.informative), by_refit, effective
    )
    assert found.value == pytest.approx(difference.mean())
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high))
    row = json.loads(printed("compare", tmp_path / "a", "--json"))["groups"][0]["comparisons"][0]
    assert row["delay_difference_s_model_ci_low"] == found.low
    assert "ratio of times, with the model" in comparison_tables(compare(run))[1].headings


def test_sentences_are_as_sure_as_the_interval_with_the_model():
    # Of 2,000 experiments in which the model had no part, 39 % had a share above one half
    # (docs/method.md): only the share's interval shows that more pairs will not help.
    findings = {"time_ratio": Finding(1.15, 1.06, 1.28)}

    def told(low: float, high: float, *share: float) -> str:
        over = {"time_ratio": OverModel(1.15, low, high, *share, 20)}
        return " ".join(note.text for note in model_notes(over, findings, ENCOUNTERS, {}))

    assert "more pairs may not help" in told(0.88, 1.44, 0.6, 0.0, 0.9)
    assert "more pairs will not help" in told(0.88, 1.44, 0.9, 0.7, 0.98)
    assert "includes 1: neither is shown to be faster" in told(0.88, 1.44, 0.2, 0.0, 0.4)
    assert told(1.01, 1.32, 0.2, 0.0, 0.4) == ""


def test_a_number_per_1000_keeps_its_name_below_the_rows():
    rows = (("PET below 1.5 s per 1,000", "150", "79", "71", "(-45 … 188)"),)
    screen = Screen("a", "b", ("", "AV", "human", "difference", "with the model"), rows, (), "c",
                    aside=True)  # fmt: skip
    assert "with the model: PET below 1.5 s per 1,000 (-45 … 188)" in screen_lines(screen, 60)


def test_agreement_of_references_includes_the_model(tmp_path):
    study = sweep("cctc", CHANGES, "arms.human=human_gmm,human_yield")
    run = run_inline(study, tmp_path / "a", engine="plain")
    (text,) = [note.text for note in reported(run).notes if "ratio of times human_gmm" in note.text]
    for cell, name in enumerate(("human_gmm", "human_yield")):
        ratio = run.over_model[cell]["time_ratio"]
        assert f"{name} {ratio.value:.3f} ({ratio.low:.3f} … {ratio.high:.3f})" in text


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("run cctc --over-model --pairs 5", "5 pairs for 20 refits"),
        (
            "run cctc --over-model --set arms.human=human_yield --set arms.av=gap_yield "
            "--set pedestrians.walking_speed.mean_mps=1.3",
            "nothing here depends on the interaction model",
        ),
        ("risk cctc --set model.over_refits=true", "is not supported by `harness risk`"),
        ("fit rows.csv --out m.json --refits 3", "0 (none), or 5 or more"),
        ("fit rows.csv --out m.json --keep-model", "needs --refits"),
    ],
)
def test_what_makes_no_sense_is_refused_in_one_line(words, told, tmp_path):
    assert told in refusal(*words.split(), cwd=tmp_path)
    assert not [*tmp_path.iterdir()]


def test_a_training_environment_refuses_refits():
    from harness.rl import CrosswalkEnv

    with pytest.raises(InputError, match=r"not supported by harness\.rl"):
        CrosswalkEnv("cctc", settings={"model.over_refits": True}, engine="plain")
