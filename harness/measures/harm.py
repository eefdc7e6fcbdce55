"""How bad a contact is: the risks of serious injury and of death from the impact speed.

The curves are those of Tefft (Accident Analysis and Prevention 50, 2013): 422 people of 15 years
and more in the USA, struck by the front of a car or a light truck.
"""

import numpy as np

from harness.core.encounter import Contact, FloatArray
from harness.measures.chunk import Chunk

_MPH = 0.44704
_RISK = np.array([0.10, 0.25, 0.50, 0.75, 0.90])
_INJURY_MPS = _MPH * np.array([17.1, 24.9, 33.0, 40.8, 48.1])
_DEATH_MPS = _MPH * np.array([24.1, 32.5, 40.6, 48.0, 54.6])

LOWEST_INJURY_MPS = float(_INJURY_MPS[0])
"""The speed of the lowest published point of serious injury, 17.1 mph."""


def injury_risk(chunk: Chunk) -> FloatArray:
    """Risk of an injury of AIS 4 or more in the contact, 0 to 1; see ``risk_at``.

    It is NaN without a contact, and for a contact with the side, about which the source says
    nothing.
    """
    return risk_at(_front_speed_mps(chunk), _INJURY_MPS)


def fatality_risk(chunk: Chunk) -> FloatArray:
    """Risk of death in the contact, 0 to 1; see ``injury_risk``."""
    return risk_at(_front_speed_mps(chunk), _DEATH_MPS)


def risk_at(speed_mps: FloatArray, points_mps: FloatArray) -> FloatArray:
    """The risk at an impact speed, from the published speeds for 10, 25, 50, 75 and 90 %.

    Between two points the logit of the risk is linear in the speed.  Above the highest point it
    keeps its last slope.  Below the lowest point the risk is linear, down to 0 at 0: this part is
    the harness's, not the source's.

    Args:
        speed_mps: impact speeds, m/s, ≥ 0; NaN stays NaN.
        points_mps: the five published speeds, m/s.

    >>> risk_at(np.array([0.0, 3.82219, 7.64438, 14.75232]), _INJURY_MPS).round(6).tolist()
    [0.0, 0.05, 0.1, 0.5]
    """
    logits = np.log(_RISK / (1 - _RISK))
    slope = (logits[-1] - logits[-2]) / (points_mps[-1] - points_mps[-2])
    beyond = np.maximum(0.0, speed_mps - points_mps[-1])
    curve = 1 / (1 + np.exp(-np.interp(speed_mps, points_mps, logits) - slope * beyond))
    risk: FloatArray = np.where(
        speed_mps < points_mps[0], _RISK[0] * speed_mps / points_mps[0], curve
    )
    return risk


def _front_speed_mps(chunk: Chunk) -> FloatArray:
    """The ego's speed at a contact with its front; NaN without one."""
    return np.array(
        [
            strike.speed_mps if strike is not None and strike.contact is Contact.FRONT else np.nan
            for strike in chunk.strikes
        ],
        dtype=float,
    )
