# The public interface (docs/python.md), each name with its module: read by type checkers, and by
# harness/__init__.py for what it imports when it is first asked for.

from .core.errors import HarnessError as HarnessError, InputError as InputError
from .core.vocabulary import (
    Arm as Arm,
    Crossing as Crossing,
    EgoView as EgoView,
    Observation as Observation,
    PedestrianView as PedestrianView,
    Side as Side,
    Strategy as Strategy,
    Vehicle as Vehicle,
)
from .model.interaction import InteractionModel as InteractionModel, load_model as load_model
from .report import figures as figures
from .report.page import Written as Written, write_report as write_report
from .results.finding import Finding as Finding
from .results.loaded_run import Run as Run, load_run as load_run
from .results.result import Result as Result
from .rl import CrosswalkEnv as CrosswalkEnv, Transition as Transition
from .scenario import (
    Scenario as Scenario,
    Setting as Setting,
    Study as Study,
    load_scenario as load_scenario,
    read_scenario_file as read_scenario_file,
    study_of as study_of,
)
from .scenario.file import ScenarioFile as ScenarioFile
from .scenario.variation import parse_variation as parse_variation
from .strategies.vector import (
    acceleration_of as acceleration_of,
    observation_vector as observation_vector,
)
from .studies.checks import check_strategy as check_strategy
from .studies.comparison import compare as compare
from .studies.evaluate import evaluate as evaluate
from .studies.one_pair import PairOutcome as PairOutcome, run_pair as run_pair
from .studies.running.run import resume as resume, run as run
from .studies.worst import worst as worst
