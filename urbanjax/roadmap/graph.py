"""The road graph: one link is one lane, with geometry, rules and neighbours in padded arrays."""

import enum

from jax import Array

from urbanjax.types import pytree, static


class Turn(enum.IntEnum):
    """Which way a link turns at a junction."""

    STRAIGHT = 0
    LEFT = 1
    RIGHT = 2
    U_TURN = 3


class Rule(enum.IntEnum):
    """Priority rule at the end of a link without a signal."""

    NONE = 0
    YIELD = 1
    STOP = 2


class RoadType(enum.IntEnum):
    """Kind of road."""

    URBAN = 0
    HIGHWAY = 1
    RAMP = 2
    JUNCTION = 3


@pytree
class RoadGraph:
    """L links with P points each (the paper's M_2D). Indices are meaningful only where the mask beside them is true.

    Coordinates are relative to `origin`, which stays on the host in double precision.
    """

    centre: Array  # [L, P, 2] m
    left: Array  # [L, P, 2] m, left border
    right: Array  # [L, P, 2] m, right border
    heading: Array  # [L, P] rad, unwrapped along each link
    curvature: Array  # [L, P] 1/m
    station: Array  # [L, P] m along the centre line, uniform: station[l, p] = length[l] * p / (P - 1)
    length: Array  # [L] m
    speed_limit: Array  # [L] m/s
    turn: Array  # [L] int32, a Turn
    road_type: Array  # [L] int32, a RoadType
    rule: Array  # [L] int32, a Rule
    valid: Array  # [L] bool, false for padding
    successor: Array  # [L, S] int32
    has_successor: Array  # [L, S] bool
    predecessor: Array  # [L, S] int32
    has_predecessor: Array  # [L, S] bool
    left_link: Array  # [L] int32, neighbour on the left in the same direction
    has_left: Array  # [L] bool
    left_change: Array  # [L] bool, a change to it is permitted; without it, the oncoming lane may be used to overtake
    left_station: Array  # [L, P] m, station on the left neighbour beside each point
    right_link: Array  # [L] int32
    has_right: Array  # [L] bool
    right_change: Array  # [L] bool
    right_station: Array  # [L, P] m
    opposite: Array  # [L, X] int32, links that use the same or the adjacent ground in the other direction
    has_opposite: Array  # [L, X] bool
    opposite_offset: Array  # [L, X] m, mean lateral offset of that link from this one, left positive (0: coincides)
    conflict: Array  # [L, X] int32, links that cross or merge with this one (not successors of a common link)
    has_conflict: Array  # [L, X] bool
    signal: Array  # [L, Y] int32, ids of the signals that govern the link's end
    has_signal: Array  # [L, Y] bool
    stop_line: Array  # [L, Y] m, station of the stop line of each signal
    area: Array  # [L] int32, index into area_names
    origin: tuple[float, float] = static(default=(0.0, 0.0))  # m, map coordinates of this frame's (0, 0)
    area_names: tuple[str, ...] = static(default=("",))
    n_signals: int = static(default=0)
