"""Options are checked when they are made, and NumPy's numbers are numbers."""

import json
from typing import Any

import numpy as np
import pytest

from harness.core.errors import InterruptedRunError
from harness.scenario import Options, load_scenario, read_scenario_file, study_of
from tests.scenes import refuses


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"engine": "plan"}, "unknown engine 'plan'"),
