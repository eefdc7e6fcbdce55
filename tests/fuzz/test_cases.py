"""In full, every kind of file that a user can hand in is tried 10,000 times or more."""

from tests.fuzz import test_models, test_run_folders, test_scenarios, test_trajectories
from tests.fuzz.hostile import planned

MODULES = (test_models, test_run_folders, test_scenarios, test_trajectories)


def test_every_kind_of_file_has_its_cases() -> None:
    assert len(planned) == len(MODULES)
    assert min(planned.values()) >= 10_000, planned
