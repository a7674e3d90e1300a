"""Fixed-time signal programs: what every signal shows at a time."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.types import Signals, SignalState, pytree


@pytree
class SignalProgram:
    """One fixed-time program per signal, G of them: green, then yellow, then red, from `offset` on."""

    cycle: Array  # [G] s
    offset: Array  # [G] s, when green begins
    green: Array  # [G] share of the cycle
    yellow: Array  # [G] s


def alternating(
    n_signals: int, n_phases: int = 2, *, cycle: float = 60.0, yellow: float = 3.0, clearance: float = 2.0
) -> SignalProgram:
    """A program in which signal g is green in phase g mod n_phases, all-red for `clearance` s between phases.

    Args: n_signals, G; n_phases, groups of signals that take turns; cycle [s]; yellow [s]; clearance [s].
    """
    phase = jnp.arange(n_signals) % n_phases
    share = 1.0 / n_phases - (yellow + clearance) / cycle
    each = jnp.ones(n_signals)
    return SignalProgram(cycle * each, phase * (cycle / n_phases), share * each, yellow * each)


def show(program: SignalProgram, time: Float[Array, ""]) -> Signals:
    """State of all signals at `time` s, and how long it lasts. Args: program, of G signals; time [] s."""
    into = jnp.mod(time - program.offset, program.cycle)
    to_yellow = program.green * program.cycle
    to_red = to_yellow + program.yellow
    is_green, is_yellow = into < to_yellow, into < to_red
    state = jnp.where(is_green, SignalState.GREEN, jnp.where(is_yellow, SignalState.YELLOW, SignalState.RED))
    until = jnp.where(is_green, to_yellow, jnp.where(is_yellow, to_red, program.cycle))
    return Signals(state.astype(jnp.int32), until - into, jnp.ones(into.shape, bool))


def always_green(n_signals: int) -> SignalProgram:
    """A program in which nobody ever has to stop, for worlds whose signals are not simulated. Args: n_signals, G."""
    each = jnp.ones(n_signals)
    return SignalProgram(each, 0 * each, each, 0 * each)
