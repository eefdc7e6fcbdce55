"""A pedestrian's quantile and the vehicle that they see in; their walking speed out."""

from functools import lru_cache

from harness.core.vocabulary import Arrival
from harness.model.interaction import InteractionModel, ModelUseCounter
from harness.scenario import Scenario

_REMEMBERED = 64
"""Size of the cache; both arms use the same speeds of pedestrians who step off at the trigger."""


class WalkingSpeeds:
    """Walking speed of each pedestrian who chooses one, by the scenario's reading of the model.

    The distribution is f(v_p | 1/R, v), f(v_p) or the scenario's own normal
    distribution, each at the pedestrian's quantile.  ``model_use`` counts the states for which the
    model was used.
    """

    def __init__(self, scenario: Scenario, model: InteractionModel) -> None:
        self.model_use = ModelUseCounter(model)
        self._model, self._normal = model, scenario.pedestrians.walking_speed
        reading = scenario.model.pedestrian_reading
        self._conditional = self._normal is None and reading != "unconditional"
        self._from_model = lru_cache(_REMEMBERED)(model.walking_speed)

    def __call__(self, arrival: Arrival, range_m: float | None, speed_mps: float | None) -> float:
        """Walking speed in m/s of a pedestrian who sees the ego at (range_m, speed_mps), or none.

        A vehicle that is past the centre line does not count.
        """
        quantile = arrival.quantile
        assert quantile is not None  # timed pedestrians never choose a speed
        if range_m is None or speed_mps is None or range_m <= 0 or not self._conditional:
            return self.unconditional(quantile, arrival.walking_class)
        self.model_use.note(range_m, speed_mps)
        return self._from_model(quantile, range_m, speed_mps)

    def unconditional(self, quantile: float, walking_class: int | None = None) -> float:
        """Walking speed in m/s at a quantile of a class, without regard to the ego."""
        if self._normal is None:
            return self._model.walking_speed_unconditional(quantile)
        return self._normal.at(quantile, walking_class)
