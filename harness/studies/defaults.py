"""Choices and defaults of studies, which the command line shows without importing a study."""

from typing import Final, Literal

Criterion = Literal["held-out", "bic", "rule"]
"""What chooses a model's number of components K."""

WhoDrove = Literal["av", "reference", "sumo"]
"""Who drove a passage: the strategy of AVs, the reference's, or SUMO."""

CRITERION: Final = "held-out"
WEIGH: Final = "encounter"
STARTS, FOLDS, SEED = 5, 5, 1
"""Of a fit: criterion, what has equal weight, starts for each K, folds of vehicles, seed."""

RANKED_BY, MOST_EPISODES = "pet_s", 20
"""Of the worst episodes: the measure, and how many are listed."""
