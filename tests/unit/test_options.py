"""Options of a run are checked before it begins, and NumPy's numbers are numbers."""

import json

import numpy as np

from harness.core.errors import InterruptedRunError
from harness.scenario import load_scenario, read_scenario_file, study_of


def test_numbers_and_arrays_of_numpy_are_numbers() -> None:
    settings = {
        "experiment.pairs": np.int64(7),
        "ego.initial_speed_mps": np.float32(8.0),
        "experiment.seed": np.arange(3)[2],
        "model.extrapolate": np.True_,
    }
    plain = {key: value.item() for key, value in settings.items()}
    assert load_scenario("cctc_flow", settings) == load_scenario("cctc_flow", plain)
    file = read_scenario_file("cctc_flow")
    flows = np.linspace(100, 300, 3)
    study = study_of(file, [("pedestrians.flow_per_hour", flows)])  # type: ignore[list-item]
    written = [dict(cell.varied) for cell in study.cells]
    expected = json.dumps([{"pedestrians.flow_per_hour": flow} for flow in (100.0, 200.0, 300.0)])
    assert json.dumps(written) == expected


def test_an_interrupted_run_is_a_keyboard_interrupt() -> None:
    """``except Exception`` of a script does not take Ctrl-C for one more failed run."""
    assert issubclass(InterruptedRunError, KeyboardInterrupt)
    assert not issubclass(InterruptedRunError, Exception)
