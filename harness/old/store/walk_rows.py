"""A pedestrian's walk as a row of ``pedestrians``, and back; and what drivers were shown."""

from harness.core.encounter import Arrival, FloatArray, Leg, Side, Trace, Walk
from harness.old.store.tables import Row


def pedestrian_row(walk: Walk, cleared: float | None, end_s: float) -> Row:
    """The row of a pedestrian, without the keys, in a record that ends at ``end_s``."""
    arrival, start_s = walk.arrival, walk.start_s
    went = start_s is not None and start_s < end_s
    legs = walk.legs if went else None
    return {
        "index": arrival.index,
        "arrival_s": arrival.arrival_s,
        "start_s": start_s if went else None,
        "side": arrival.side.value,
        "quantile": arrival.quantile,
        "critical_gap_s": arrival.critical_gap_s,
        "threshold_s": arrival.threshold_s,
        "latency_s": arrival.latency_s,
        "speed_mps": walk.speed_mps if went else None,
        "range_m": walk.range_m if went else None,
        "vehicle_speed_mps": walk.vehicle_speed_mps if went else None,
        "cleared_s": cleared if went and cleared is not None and cleared <= end_s else None,
        "legs": legs and [leg._asdict() for leg in legs],
        "delay_s": start_s - arrival.arrival_s if went and start_s is not None else None,
        "let_go": None,
    }


def stored_walk(row: Row) -> Walk:
    """The walk of a stored row."""
    legs = row["legs"]
    return Walk(
        Arrival(row["index"], row["arrival_s"], Side(row["side"]), row["quantile"]),
        row["start_s"],
        row["speed_mps"],
        row["range_m"],
        row["vehicle_speed_mps"],
        None if legs is None else tuple(Leg(**leg) for leg in legs),
    )


def shown_states(trace: Trace, times: FloatArray) -> dict[int, list[tuple[float | None, ...]]]:
    """The perceived states of each pedestrian by index, for the times at which they were shown."""
    states: dict[int, list[tuple[float | None, ...]]] = {}
    for time, views in zip(times.tolist(), trace.shown or (), strict=False):
        for view in views:
            y_m = trace.crossing.place_of(view.side, view.remaining_m)
            states.setdefault(view.index, []).append((time, 0.0, y_m, view.speed_mps, None))
    return states
