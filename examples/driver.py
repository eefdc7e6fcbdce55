#!/usr/bin/env python3
"""A strategy in a process of its own: arms.av = "exec:./driver.py --comfortable 2.5".

One JSON line for each observation on standard input, one number (m/s²) back on standard output.
Needs no package; what is printed for people goes to standard error.
"""

import argparse
import json
import sys

PASSED_M = -1.85
"""Who is so far past the centre of the ego's lane has left the ego's path."""


def decide(seen, comfortable):
    """Stop at the stop line for whoever is on the crossing and not past the lane; else go to v0."""
    ego, vehicle = seen["ego"], seen["vehicle"]
    room = ego["range_m"] - seen["crossing"]["stop_line_m"]
    speed = ego["speed_mps"]
    in_the_way = any(
        person["on_crossing"] and person["lateral_m"] > PASSED_M for person in seen["pedestrians"]
    )
    if in_the_way and room > 0 and speed**2 / (2 * room) > comfortable:
        return -(speed**2) / (2 * room)
    if in_the_way and ego["range_m"] > 0:
        return 0.0 if room > 0 else -vehicle["max_deceleration_mps2"]
    # The later the vehicle obeys, the longer it takes to get to v0, or it would overshoot.
    time_s = seen["step_s"] + 3 * (vehicle["dead_time_s"] + vehicle["lag_s"])
    wanted = (vehicle["initial_speed_mps"] - speed) / time_s
    return min(vehicle["resume_acceleration_mps2"], wanted)


def main():
    """Answer line after line until standard input ends."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--comfortable", type=float, default=2.5, help="m/s², from which it brakes")
    comfortable = parser.parse_args().comfortable
    for line in sys.stdin:
        print(decide(json.loads(line), comfortable), flush=True)


if __name__ == "__main__":
    main()
