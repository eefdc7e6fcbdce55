"""A pedestrian's quantile and the vehicle that they see in; their walking speed out."""

from functools import lru_cache

import numpy as np

from harness.core.encounter import Arrival, Side
from harness.model.interaction import InteractionModel, ModelUseCounter
from harness.scenario import Scenario

_REMEMBERED = 64
"""Size of the cache; both arms use the same speeds of pedestrians who step off at the trigger."""


class WalkingSpeeds:
    """Walking speed of each pedestrian who chooses one, by the scenario's reading of the model.

    The distribution is f(v_p | 1/R, v), f(v_p | R, v, L), f(v_p) or the scenario's own normal
    distribution, each at the pedestrian's quantile.  ``model_use`` counts the states for which the
    model was used.
    """

    def __init__(self, scenario: Scenario, model: InteractionModel) -> None:
        self.model_use = ModelUseCounter(model)
        self._model, self._reading = model, scenario.model.pedestrian_reading
        self._normal = scenario.pedestrians.walking_speed
        self._lateral_m = {side: scenario.crosswalk().to_lane_m(side) for side in Side}
        self._answer = lru_cache(_REMEMBERED)(self._from_model)

    def __call__(
        self, arrival: Arrival, range_m: float, speed_mps: float, lateral_m: float | None = None
    ) -> float:
        """Walking speed in m/s of a pedestrian who sees the ego at (range_m, speed_mps).

        ``lateral_m`` is their L; None means L at their kerb.
        """
        quantile = arrival.quantile
        assert quantile is not None  # timed pedestrians never choose a speed
        if range_m <= 0 or self._normal is not None or self._reading == "unconditional":
            return self.unconditional(quantile, arrival.walking_class)
        self.model_use.note(range_m, speed_mps)
        if lateral_m is None:
            lateral_m = self._lateral_m[arrival.side]
        return self._answer(quantile, range_m, speed_mps, lateral_m)

    def _from_model(
        self, quantile: float, range_m: float, speed_mps: float, lateral_m: float
    ) -> float:
        # The curve is undefined past the centre of the ego's lane, where L ≤ 0.
        if self._reading == "curve" and lateral_m > 0:
            state = ([quantile], [range_m], [lateral_m], [speed_mps])
            walking = self._model.walking_speed_on_curve(*map(np.array, state))
            # If no walking speed lies in the model's box, the speed does not depend on L.
            if not np.isnan(walking[0]):
                return float(walking[0])
        return self._model.walking_speed_at(quantile, range_m, speed_mps)

    def unconditional(self, quantile: float, walking_class: int | None = None) -> float:
        """Walking speed in m/s at a quantile of a class, without regard to the ego."""
        if self._normal is None:
            return self._model.walking_speed_unconditional(quantile)
        return self._normal.at(quantile, walking_class)
