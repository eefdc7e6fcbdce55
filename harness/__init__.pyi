# The public interface (docs/python.md), each name with its module: read by type checkers, and by
# harness/__init__.py for what it imports when it is first asked for.

from .core.encounter import (
    Arm as Arm,
    Crossing as Crossing,
    EgoView as EgoView,
    Observation as Observation,
    PedestrianView as PedestrianView,
    Side as Side,
    Strategy as Strategy,
    Vehicle as Vehicle,
)
from .core.errors import HarnessError as HarnessError, InputError as InputError
from .model.interaction import InteractionModel as InteractionModel, load_model as load_model
from .old.report import figures as figures
from .old.report.one_pair import (
    EpisodeOutcome as EpisodeOutcome,
    PairOutcome as PairOutcome,
    run_pair as run_pair,
)
from .old.studies.batch.experiment import resume as resume, run_study as run_study
from .old.studies.candidates.evaluation import evaluate as evaluate
from .old.studies.conformance import check_strategy as check_strategy
from .old.studies.runs.compare import compare as compare
from .old.studies.runs.comparisons import RunComparison as RunComparison
from .old.studies.runs.opening import load_run as load_run
from .old.studies.runs.run_data import RunData as RunData
from .old.studies.runs.worst import (
    WorstEpisode as WorstEpisode,
    got_worse as got_worse,
    worst as worst,
)
from .rl import CrosswalkEnv as CrosswalkEnv, Transition as Transition
from .scenario import (
    Options as Options,
    Scenario as Scenario,
    ScenarioFile as ScenarioFile,
    Setting as Setting,
    Study as Study,
    load_scenario as load_scenario,
    parse_variation as parse_variation,
    read_scenario_file as read_scenario_file,
    study_of as study_of,
)
from .strategies.vector import (
    acceleration_of as acceleration_of,
    observation_vector as observation_vector,
)
