"""Outcomes inside jit: integers with names, since an exception cannot leave a compiled program."""

import enum


class RouteStatus(enum.IntEnum):
    """How a route search ended."""

    OK = 0
    UNREACHABLE = 1
    TOO_LONG = 2


class Decision(enum.IntEnum):
    """Why task-specific path selection chose its path (Fig. 5, in the order of the tree)."""

    ROUTE_FEASIBLE = 0
    STUCK_ESCAPE = 1
    MICRO_INFEASIBLE = 2
    TURN_AT_SIGNAL = 3
    SIDE_OCCUPIED = 4
    OVERTAKE = 5
    EMERGENCY_STOP = 6
