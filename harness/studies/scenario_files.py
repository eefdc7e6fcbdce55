"""What a command or function is asked to run in; a scenario's file out.

For a command this is apart, so that it refuses a misspelt key before it imports tables and models.
"""

from pathlib import Path

from harness.core.errors import reading
from harness.core.files import shipped_directory
from harness.scenario import Scenario, read_scenario_file, study_from
from harness.scenario.file import ScenarioFile, Settings, as_settings


def scenario_file(scenario: Scenario | str | Path, settings: Settings) -> ScenarioFile:
    """A scenario, the file or name of one, or the folder of a run, with settings, as a file.

    The folder of a run has the study of its manifest, whose paths are absolute.

    Raises:
        InputError: the file is no scenario, or the folder holds no run.
    """
    if isinstance(scenario, Scenario) or not (folder := Path(scenario)).is_dir():
        return read_scenario_file(scenario, settings)
    if (shipped_directory("scenarios") / f"{folder}.toml").is_file():
        return read_scenario_file(scenario, settings)
    from harness.results import folder as folders  # which a file does not need

    where = str(folder / folders.MANIFEST)
    with reading(where):
        study = study_from(folders.read_manifest(folder, old=True), where)
    cells = [{k: v for k, v in cell.varied.items() if v is not None} for cell in study.cells]
    tree, given = study.base.model_dump(), as_settings(settings)
    sweep = cells if study.varied_keys else None
    return ScenarioFile(study.name, where, tree, sweep, given, Path.cwd())
