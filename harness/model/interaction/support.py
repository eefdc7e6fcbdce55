"""Takes states of the ego and returns how often the interaction model is used outside its box."""

from harness.core.encounter import NO_MODEL_USE, ModelUse
from harness.core.errors import InputError
from harness.model.interaction.model import INVERSE_RANGE, VEHICLE_SPEED, InteractionModel

# Relative: 1/(1/60) may differ from 60 in its last bit.
_ROUNDING = 1e-9


class ModelUseCounter:
    """Counts the uses of the model in an episode by the state of the ego.

    The model's conditions are clamped to its box, so for a farther or faster ego the answer belongs
    to another state.  An ego that stands, or that is nearer than any in the data, is clamped too
    but counted separately, because the answer for the slowest or nearest ego in the data also
    applies to it.
    """

    def __init__(self, model: InteractionModel) -> None:
        lower, upper = model.mixture.lower, model.mixture.upper
        self.ranges_m = 1 / float(upper[INVERSE_RANGE]), 1 / float(lower[INVERSE_RANGE])
        self.speeds_mps = float(lower[VEHICLE_SPEED]), float(upper[VEHICLE_SPEED])
        self.begin()

    def begin(self) -> None:
        """Begin a new episode."""
        self.counts = NO_MODEL_USE

    def note(self, range_m: float, speed_mps: float) -> None:
        """Count a use of the model with the ego in this state."""
        (nearest, farthest), (slowest, fastest) = self.ranges_m, self.speeds_mps
        uses, clamped, near, speed_excess, range_excess = self.counts
        beyond_m, beyond_mps = range_m - farthest, speed_mps - fastest
        if beyond_m > _ROUNDING * farthest or beyond_mps > _ROUNDING * fastest:
            clamped += 1
            speed_excess = max(speed_excess, beyond_mps)
            range_excess = max(range_excess, beyond_m)
        elif nearest - range_m > _ROUNDING * nearest or slowest - speed_mps > _ROUNDING * fastest:
            near += 1
        self.counts = ModelUse(uses + 1, clamped, near, speed_excess, range_excess)


def check_support(
    model: InteractionModel,
    range_m: float,
    speed_mps: float,
    speed_key: str = "ego.initial_speed_mps",
) -> None:
    """Raise if the model has no data for the state of the ego at the trigger.

    ``speed_key`` is the key of the scenario that gives the speed.

    Raises:
        InputError: v0 or R0 is outside the model's box.
    """
    support = ModelUseCounter(model)
    for key, value, unit, (low, high) in (
        (speed_key, speed_mps, "m/s", support.speeds_mps),
        ("ego.trigger_range_m", range_m, "m", support.ranges_m),
    ):
        if not low * (1 - _ROUNDING) <= value <= high * (1 + _ROUNDING):
            raise InputError(
                key,
                f"{value:g} {unit} is outside the box of model {model.name!r}",
                f"{low:g} to {high:g} {unit}; [pedestrians.walking_speed] or "
                'model.pedestrian_reading = "unconditional" and an arm other than human_gmm; '
                "or model.extrapolate = true, which clamps",
            )
