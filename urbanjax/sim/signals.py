"""Fixed-time signal programs: what every signal shows at a time."""

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from urbanjax.types import ScenarioError, Signals, SignalState, as_arrays, host_record, pytree

ROUNDING = 1e-3  # s, by which sums of periods may be off: a phase that begins within it has begun


@host_record
class SignalCycle:
    """A fixed-time program of one signal, as a map states it: any sequence of phases."""

    duration: tuple[float, ...]  # s
    state: tuple[int, ...]  # a SignalState each; UNKNOWN where the signal is off
    offset: float = 0.0  # s, when the first phase begins


@pytree
class SignalProgram:
    """One fixed-time program per signal, G of them: green, then yellow, then red, from `offset` on."""

    cycle: Array  # [G] s
    offset: Array  # [G] s, when green begins
    green: Array  # [G] share of the cycle
    yellow: Array  # [G] s


@pytree
class SignalPhases:
    """One fixed-time program of any phases per signal, G of them with at most P phases each."""

    cycle: Array  # [G] s
    offset: Array  # [G] s, when the first phase begins
    end: Array  # [G, P] s after that, of each phase; infinite where it never ends
    phase: Array  # [G, P] int32, a SignalState each


def phases(cycles: Sequence[SignalCycle | None], n_signals: int) -> SignalPhases:
    """The programs that a map states; a signal without one is green, and so is one while it is off (host side).

    Args: cycles, of the signals from the first one on; n_signals, G. Raises ScenarioError for a cycle without
    duration, with a negative one, or with another number of states.
    """
    rows = [_distinct(g, cycle) for g, cycle in enumerate((*cycles, *[None] * n_signals)[:n_signals])]
    most = max((len(ends) for _, _, ends, _ in rows), default=1)
    padded: dict[str, Any] = {
        "cycle": np.array([cycle for cycle, *_ in rows]),
        "offset": np.array([offset for _, offset, *_ in rows]),
        "end": np.array([ends + ends[-1:] * (most - len(ends)) for _, _, ends, _ in rows]).reshape(-1, most),
    }
    states = [states + states[-1:] * (most - len(states)) for *_, states in rows]
    return SignalPhases(**as_arrays(padded), phase=jnp.asarray(np.array(states, np.int32).reshape(-1, most)))


def stated(cycle: SignalCycle | None) -> bool:
    """Whether a map says when a signal is open: it has a program in which it is not off all the time. Args: cycle."""
    return cycle is not None and any(state != SignalState.UNKNOWN for state in cycle.state)


def _distinct(g: int, cycle: SignalCycle | None) -> tuple[float, float, list[float], list[int]]:
    """Cycle, offset within it, ends and states of phases, such that each differs from the one before, or is alone."""
    if cycle is None:
        return 1.0, 0.0, [np.inf], [int(SignalState.GREEN)]
    if len(cycle.duration) != len(cycle.state) or sum(cycle.duration) <= 0 or min(cycle.duration) < 0:
        raise ScenarioError(
            f"the cycle of signal {g} has the durations {cycle.duration} and the states {cycle.state}: give as many of "
            "each, and durations of 0 s or more that are not all 0"
        )
    off = int(SignalState.UNKNOWN)
    pairs = zip(cycle.duration, cycle.state, strict=True)
    shown = [(d, int(SignalState.GREEN) if s == off else int(s)) for d, s in pairs if d > 0]
    total, begin = float(sum(cycle.duration)), cycle.offset
    while len(shown) > 1 and shown[0][1] == shown[-1][1] and len({state for _, state in shown}) > 1:
        shown = [shown[-1], *shown[:-1]]
        begin -= shown[0][0]
    ends: list[float] = []
    states: list[int] = []
    for end, (_, state) in zip(np.cumsum([d for d, _ in shown]), shown, strict=True):
        if states and states[-1] == state:
            ends[-1] = float(end)
        else:
            ends, states = [*ends, float(end)], [*states, state]
    return total, begin % total, ends if len(ends) > 1 else [np.inf], states


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


def show(program: SignalProgram | SignalPhases, time: Float[Array, ""]) -> Signals:
    """State of all signals at `time` s, and how long it lasts. Args: program, of G signals; time [] s."""
    if isinstance(program, SignalPhases):
        return _show_phases(program, time)
    into = jnp.mod(time - program.offset, program.cycle)
    to_yellow = program.green * program.cycle
    to_red = to_yellow + program.yellow
    is_green, is_yellow = into < to_yellow, into < to_red
    state = jnp.where(is_green, SignalState.GREEN, jnp.where(is_yellow, SignalState.YELLOW, SignalState.RED))
    until = jnp.where(is_green, to_yellow, jnp.where(is_yellow, to_red, program.cycle))
    return Signals(state.astype(jnp.int32), until - into, jnp.ones(into.shape, bool))


def _show_phases(program: SignalPhases, time: Float[Array, ""]) -> Signals:
    into = jnp.mod(time + ROUNDING - program.offset, program.cycle)
    into = jnp.where(into < program.cycle, into, 0)  # the remainder of a small negative number is rounded to all of it
    now = jnp.sum(into[:, None] >= program.end[:, :-1], axis=1)[:, None]
    state, end = (jnp.take_along_axis(x, now, axis=1)[:, 0] for x in (program.phase, program.end))
    return Signals(state, end - into + ROUNDING, jnp.ones(into.shape, bool))


def always_green(n_signals: int) -> SignalProgram:
    """A program in which nobody ever has to stop, for worlds whose signals are not simulated. Args: n_signals, G."""
    each = jnp.ones(n_signals)
    return SignalProgram(each, 0 * each, each, 0 * each)
