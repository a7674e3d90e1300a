"""Traffic signals as the vehicle knows them."""

import enum

from jax import Array

from urbanjax.types.struct import pytree


class SignalState(enum.IntEnum):
    """What a signal shows; `UNKNOWN` is also what a stale message means."""

    UNKNOWN = 0
    RED = 1
    YELLOW = 2
    GREEN = 3


@pytree
class Signals:
    """State of every signal of the map, indexed by signal id."""

    state: Array  # [G] int32, a SignalState
    remaining: Array  # [G] s until the state changes
    valid: Array  # [G] bool
