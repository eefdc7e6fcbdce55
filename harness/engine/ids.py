"""How SUMO makes the ids of edges and lanes."""

_INSIDE = ":"
"""How the ids of what is inside a junction begin."""


def edge_of(lane: str) -> str:
    """The id of the edge of a lane, which is empty where a vehicle is on none.

    >>> edge_of("A0_B0_1"), edge_of("")
    ('A0_B0', '')
    """
    return lane.rpartition("_")[0]


def lane_of(edge: str, number: int = 0) -> str:
    """The id of a lane of an edge; lanes are counted from the right."""
    return f"{edge}_{number}"


def is_inside_junction(lane: str) -> bool:
    """Whether a lane or an edge is inside a junction."""
    return lane.startswith(_INSIDE)


def name_inside_junction(edge: str) -> str:
    """The id of an edge inside a junction, without the mark that it is there."""
    return edge.removeprefix(_INSIDE)
