"""Makes the rows of the player's traces from a trace."""

import numpy as np
import pandas as pd

from harness.core.encounter import Trace, Walk
from harness.measures.motion.walking import cleared_s, states_at


def ego_rows(trace: Trace) -> pd.DataFrame:
    """Return the vehicle's positions at every step."""
    columns = {
        "time_s": np.arange(len(trace.x_m)) * trace.step_s,
        "object": "ego",
        "x_m": trace.x_m,
        "y_m": trace.crossing.lane_centre_m,
        "speed_mps": trace.speed_mps,
    }
    return pd.DataFrame(columns)


def walk_rows(walk: Walk, trace: Trace) -> pd.DataFrame:
    """Return a pedestrian's positions at the steps at which they are on the road."""
    begin_s = walk.arrival.arrival_s if walk.start_s is None else walk.start_s
    last, cleared = len(trace.x_m) - 1, cleared_s(walk, trace.crossing)
    if cleared is not None:
        last = min(last, int(cleared / trace.step_s))
    first = int(np.ceil(begin_s / trace.step_s - 1e-9))
    times_s = np.arange(first, last + 1, dtype=np.float64) * trace.step_s
    x, y, speed, _ = states_at(walk, trace.crossing, times_s)
    name = f"pedestrian-{walk.arrival.index}"
    columns = {"time_s": times_s, "object": name, "x_m": x, "y_m": y, "speed_mps": speed}
    return pd.DataFrame(columns)
