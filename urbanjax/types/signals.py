"""Traffic signals as the vehicle knows them."""

import enum

import jax.numpy as jnp
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

    def shown(self, signal: Array) -> Array:
        """The SignalState [*s] int32 to act upon: red where it is unknown, invalid, or of a signal not told about.

        The only reading of `state` that a driver may use. Args: signal [*s] int32, ids of signals.
        """
        if self.state.shape[0] == 0:
            return jnp.full(jnp.shape(signal), int(SignalState.RED), jnp.int32)
        known = self.valid & (self.state != SignalState.UNKNOWN)
        state = jnp.where(known, self.state, int(SignalState.RED))
        return state.at[signal].get(mode="fill", fill_value=int(SignalState.RED))

    def lasts(self, signal: Array) -> Array:
        """For how long [*s] s each signal still shows what it does; infinite where nobody says so.

        Args: signal [*s] int32, ids of signals.
        """
        if self.state.shape[0] == 0:
            return jnp.full(jnp.shape(signal), jnp.inf, self.remaining.dtype)
        told = self.valid & jnp.isfinite(self.remaining) & (self.remaining > 0)
        return jnp.where(told, self.remaining, jnp.inf).at[signal].get(mode="fill", fill_value=jnp.inf)
