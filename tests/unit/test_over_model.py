"""The interval that includes the model's fit: it covers a known truth, the usual one does not."""

import numpy as np
import pytest

from harness.results.finding import Finding
from harness.results.over_model import combined
from tests.batches import here

REFITS = 20


@pytest.mark.parametrize("sd", [0.1, 1.0, 3.0])
def test_the_interval_covers_a_known_truth(sd: float) -> None:
    """The fit has an error N(0, 1), refits spread around it with variance 1, pairs add N(0, C).

    The truth is 0.  Refits share their pairs, so they share the error of the pairs.
    """
    rng = np.random.default_rng(3)
    covered, usual, shares = [], [], []
    for _ in range(1_500):
        values = rng.normal() + rng.normal(size=REFITS) + rng.normal(0.0, sd)
        found = [Finding(of, of - 1.96 * sd, of + 1.96 * sd, reliable=True) for of in values]
        number, share = combined(found)
        covered.append(number.low <= 0.0 <= number.high)
        usual.append(found[0].low <= 0.0 <= found[0].high)
        shares.append(share)
    assert 0.93 <= np.mean(covered) <= 0.985
    assert np.mean(usual) < 0.94
    # S² (1 + 1/R), which is 1.05, beside C.
    assert np.median(shares) == pytest.approx(1.05 / (1.05 + sd**2), abs=0.05)


def test_undefined_or_without_interval() -> None:
    whole = [Finding(0.5, 0.4, 0.6, reliable=True)] * 4
    number, share = combined([*whole, Finding(None)])
    assert (number.value, share) == (None, None)
    number, share = combined([*whole, Finding(0.5)])
    assert (number.value, number.low, share) == (0.5, None, None)
    number, share = combined(whole)
    assert (number.low, number.high, share) == (pytest.approx(0.4), pytest.approx(0.6), 0.0)


def test_from_the_shell(tmp_path) -> None:
    given = ("run", "cctc", "--pairs", 3, "--engine", "plain", "--over-model")
    done = here(*given, "--out", tmp_path / "r", "--full")
    assert done.returncode == 0
    assert "over 20 refits, with the fit's error" in done.stdout
    (tmp_path / "mine.json").write_text("{}", encoding="utf-8")
    done = here("run", "cctc", "--set", f"model.path={tmp_path / 'mine.json'}", "--over-model")
    assert done.returncode == 2
