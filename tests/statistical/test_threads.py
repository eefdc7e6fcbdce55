"""What is drawn and fitted is the same to the last bit at any number of BLAS's threads."""

import os
import subprocess
import sys

import pytest

DRAWS = """
import hashlib
import numpy as np
from harness.model.interaction import load_model
from harness.model.mixture.conditional import Conditional
model, rng = load_model("dut-k10"), np.random.default_rng(7)
rows = model.mixture.sample(2_000, rng)
conditional = Conditional(model.mixture, 2, (0, 1, 3))
y = rows[:, [0, 1, 3]]
found = [rows, conditional.ppf(rng.random(2_000), y), conditional.mode(y)]
states = zip(rng.random(500).tolist(), 1 / rows[:500, 0], rows[:500, 1])
found.append(np.array([model.walking_speed(*state) for state in states]))
print(hashlib.sha256(b"".join(part.tobytes() for part in found)).hexdigest())
"""


FITS = """
import hashlib
import numpy as np
from harness.model.mixture.conditional import Conditional
from harness.model.mixture.fitting import Search, fit_mixture
from tests.densities import truth
box = truth()
rows = box.sample(6_000, np.random.default_rng(1))
fit = fit_mixture(rows, 10, box.lower, box.upper, Search(1, starts=1, max_iter=25)).mixture
u = np.random.default_rng(2).random(len(rows))
found = [rows, Conditional(box, 2, [0, 1]).ppf(u, rows[:, [0, 1]])]
found += [fit.weights, fit.locations, fit.scale_matrices]
print(hashlib.sha256(b"".join(part.tobytes() for part in found)).hexdigest())
"""


@pytest.mark.parametrize("script", [DRAWS, pytest.param(FITS, marks=pytest.mark.slow)])
def test_same_seed_same_numbers_at_any_number_of_threads(script):
    printed = []
    for count in ("1", "2"):
        names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
        environment = os.environ | dict.fromkeys(names, count)
        command = [sys.executable, "-c", script]
        printed.append(subprocess.check_output(command, env=environment, text=True))
    assert len(printed[0]) > 60
    assert len(set(printed)) == 1
