"""The findings about people: simulated beside measured, and how far apart they are."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from harness.core.encounter import FloatArray
from harness.studies.validation.people.measured import Experiment

SCHEMA = 1
"""Version of the JSON of ``harness validate people``."""


@dataclass(frozen=True, slots=True)
class Row:
    """One measured number and the simulated one.

    Attributes:
        cell: the cell in words.
        number: what is measured there, with its unit; empty for a share.
        measured: the measured number; None if none is shipped.
        trials: the number of measured trials; None if it is unknown.
        simulated: the simulated number; None if it is undefined.
        standard_error: of the simulated number; None if it is undefined.
        simulated_trials: the number of trials, or of people, that were simulated.
        handbook: the number by NCHRP 17-87's revised form; None if it says nothing about it.
        contacts: simulated trials with a contact; None if they are not counted.
    """

    cell: str
    number: str
    measured: float | None
    trials: int | None
    simulated: float | None
    standard_error: float | None
    simulated_trials: int
    handbook: float | None = None
    contacts: int | None = None


@dataclass(frozen=True, slots=True)
class Scores:
    """How far numbers are from measured ones.

    Attributes:
        mean_error: mean of simulated − measured.
        mean_absolute_error, largest_error: of their absolute values.
        r2: 1 − Σ error²/Σ (measured − mean)²; below 0 the mean of the measured is nearer.
    """

    mean_error: float
    mean_absolute_error: float
    largest_error: float
    r2: float | None


@dataclass(frozen=True, slots=True)
class Held:
    """One experiment with one driver; ``driver`` is empty where no driver of ours takes part.

    ``scores`` is None if a number is undefined or not measured; ``handbook`` is None if the
    handbook says nothing about the experiment.  ``model_limits`` are the greatest speed (m/s) and
    range (m) in the data of the interaction model, if the driver asks it beyond them.
    """

    experiment: Experiment
    driver: str
    rows: tuple[Row, ...]
    scores: Scores | None
    handbook: Scores | None = None
    model_limits: tuple[float, float] | None = None

    @property
    def trials(self) -> int:
        """Number of measured trials; 0 if it is unknown."""
        return sum({row.cell: row.trials or 0 for row in self.rows}.values())

    @property
    def line(self) -> str:
        """The experiment, the driver and the mean absolute error, for ``--quiet``."""
        error = "undefined" if self.scores is None else f"{self.scores.mean_absolute_error:.3f}"
        return " ".join(filter(None, (self.experiment.key, self.driver, error)))


@dataclass(frozen=True, slots=True)
class PeopleFindings:
    """A behaviour and drivers, held against measured people."""

    behaviour: str
    drivers: tuple[str, ...]
    seed: int
    trials: int
    hours: int
    held: tuple[Held, ...]

    def document(self) -> dict[str, object]:
        """Return the findings for JSON."""
        return {"schema": SCHEMA, **asdict(self)}


def held(
    experiment: Experiment,
    driver: str,
    rows: Sequence[Row],
    model_limits: tuple[float, float] | None = None,
) -> Held:
    """Return an experiment with its scores."""
    measured = [row.measured for row in rows]
    return Held(
        experiment,
        driver,
        tuple(rows),
        _scores([row.simulated for row in rows], measured),
        _scores([row.handbook for row in rows], measured),
        model_limits,
    )


def _scores(values: Sequence[float | None], measured: Sequence[float | None]) -> Scores | None:
    if None in values or None in measured:
        return None
    return scores(np.array(values, dtype=float), np.array(measured, dtype=float))


def scores(values: FloatArray, measured: FloatArray) -> Scores:
    """Return how far values are from measured ones, both of shape (n,), n ≥ 1.

    >>> scores(np.array([2.0, 3.0]), np.array([1.0, 3.0]))
    Scores(mean_error=0.5, mean_absolute_error=0.5, largest_error=1.0, r2=0.5)
    """
    errors = values - measured
    spread = float(((measured - measured.mean()) ** 2).sum())
    return Scores(
        mean_error=float(errors.mean()),
        mean_absolute_error=float(np.abs(errors).mean()),
        largest_error=float(np.abs(errors).max()),
        r2=1 - float((errors**2).sum()) / spread if spread else None,
    )
