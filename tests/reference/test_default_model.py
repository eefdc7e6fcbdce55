"""The shipped models against the data they say they were fitted on.

The DUT set is no part of the project; where it lies beside the repository the models must be nearly
at maxima of the likelihood, and a fit with the same K must find no lower one.
"""

from pathlib import Path

import numpy as np
import pytest

from harness.model.interaction import VARIABLES, load_model
from harness.model.mixture.fitting import climb
from harness.model.mixture.likelihood import Likelihood
from harness.model.mixture.normals import Normals
from harness.model.sample import make_sample
from harness.model.trajectories.extraction import extract
from harness.studies.models.fits import FitSettings, fit

DUT = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "dut"
needs_dut = pytest.mark.skipif(
    not (DUT / "data" / "trajectories_filtered").is_dir(),
    reason="needs the DUT set in ../shared/data/dut beside the repository",
)
NAMES = ("dut", "dut-k10")


@pytest.mark.parametrize("name", NAMES)
def test_walking_speeds_at_the_papers_state_are_those_of_people(name):
    model = load_model(name)
    slow, median, fast = (model.walking_speed(u, 30.0, 5.0) for u in (0.05, 0.5, 0.95))
    # Tarawneh 2001: mean 1.34 m/s; HCM 2010: 1.30 to 1.44; the sample is of people on a campus.
    assert median == pytest.approx(1.35, abs=0.2)
    assert 0.3 < slow < 1.15
    assert 1.4 < fast < 2.6


def penalised(mixture, sample):
    return sample.weights @ mixture.logpdf(sample.data) + np.log(mixture.masses).sum()


@pytest.fixture(scope="module")
def sample():
    return make_sample(extract(DUT, "vci").rows)


@needs_dut
@pytest.mark.parametrize("name", NAMES)
def test_climbing_on_from_it_ends_at_nearly_the_same_density(name, sample):
    model = load_model(name)
    shipped = model.mixture
    assert sample.data.shape == (model.provenance["rows"], len(VARIABLES))
    share = sample.weights / sample.weights.sum()
    centre = share @ sample.data
    spread = np.sqrt(share @ (sample.data - centre) ** 2)
    box = (shipped.lower - centre) / spread, (shipped.upper - centre) / spread
    standard = (sample.data - centre) / spread
    likelihood = Likelihood(standard, sample.weights, *box)
    scales = shipped.scale_matrices / np.outer(spread, spread)
    first = Normals(shipped.weights, (shipped.locations - centre) / spread, scales)
    (end,) = climb(likelihood, first, 1e-7, 1000)
    assert end.gradient_norm < 1e-7
    units = sample.weights.sum() * np.log(spread).sum()
    gained = end.end.objective - units - penalised(shipped, sample)
    # Of the penalised log-likelihood, in nats over 486 encounters.
    assert -1e-6 < gained < 0.5


@needs_dut
@pytest.mark.slow
@pytest.mark.parametrize(("name", "starts"), [("dut", 5), ("dut-k10", 20)])
def test_fitting_again_finds_no_less(name, starts, sample):
    model = load_model(name)
    settings = FitSettings((model.mixture.weights.size,), starts=starts, folds=0)
    again = fit(sample, settings).chosen.fit.mixture
    assert penalised(again, sample) >= penalised(model.mixture, sample)


@needs_dut
def test_the_cards_have_the_tracks_of_the_data(sample):
    assert len(sample.tracks) == sample.vehicles == 33
    for name in NAMES:
        assert load_model(name).provenance["tracks"] == sample.tracks
