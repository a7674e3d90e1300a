"""Outcomes inside jit: integers with names, since an exception cannot leave a compiled program."""

import enum


class Status(enum.IntEnum):
    """How a search or a registration ended: a value inside jit, with a message for whoever reads it outside."""

    message: str

    def __new__(cls, value: int, message: str) -> "Status":
        """A member that is its number."""
        member = int.__new__(cls, value)
        member._value_, member.message = value, message
        return member

    OK = 0, "as it should be"
    UNREACHABLE = 1, "the goal cannot be reached from the start by links and permitted lane changes"
    TOO_LONG = 2, "the route has more links than the table holds that was made for it"
    NOT_CONVERGED = 3, "the iterations ended before the steps became small"
    NO_PAIRS = 4, "no point of the source found a place in the target nearby: begin nearer, or raise resolution"


class Decision(enum.IntEnum):
    """Why task-specific path selection chose its path (Fig. 5, in the order of the tree)."""

    ROUTE_FEASIBLE = 0
    STUCK_ESCAPE = 1
    MICRO_INFEASIBLE = 2
    TURN_AT_SIGNAL = 3
    SIDE_OCCUPIED = 4
    OVERTAKE = 5
    EMERGENCY_STOP = 6
