"""A scene as one tidy table of trajectories (docs/export.md)."""

import pandas as pd

from harness.old.studies.export.scene import Scene


def trajectories(scene: Scene) -> bytes:
    """Return the bytes of a CSV file with one row for each object and moment.

    ``object, kind, time_s, road_x_m, road_y_m, network_x_m, network_y_m, heading_rad, speed_mps,
    length_m, width_m``; positions are a vehicle's front bumper and a pedestrian's centre.
    """
    parts = []
    for mover in scene.movers:
        x, y = scene.frame.to_network(mover.x_m, mover.y_m)
        vehicle = mover.vehicle
        columns = {
            "object": mover.name,
            "kind": "pedestrian" if vehicle is None else "vehicle",
            "time_s": mover.time_s,
            "road_x_m": mover.x_m,
            "road_y_m": mover.y_m,
            "network_x_m": x,
            "network_y_m": y,
            "heading_rad": scene.headings(mover),
            "speed_mps": mover.speed_mps,
            "length_m": None if vehicle is None else vehicle.length_m,
            "width_m": None if vehicle is None else vehicle.width_m,
        }
        parts.append(pd.DataFrame(columns))
    text: str = (
        pd.concat(parts, ignore_index=True).round(6).to_csv(index=False, lineterminator="\n")
    )
    return text.encode()
