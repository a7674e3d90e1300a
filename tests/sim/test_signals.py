import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.sim.signals import SignalCycle, SignalProgram, alternating, phases, show, stated
from urbanjax.types import ScenarioError, SignalState

OFF, RED, YELLOW, GREEN = map(int, SignalState)


def test_program_runs_through_its_phases():
    program = SignalProgram(jnp.asarray([60.0]), jnp.asarray([10.0]), jnp.asarray([0.5]), jnp.asarray([3.0]))
    expected = {
        10.0: (SignalState.GREEN, 30.0),
        39.0: (SignalState.GREEN, 1.0),
        41.0: (SignalState.YELLOW, 2.0),
        43.5: (SignalState.RED, 26.5),
        69.0: (SignalState.RED, 1.0),
        70.0: (SignalState.GREEN, 30.0),
        5.0: (SignalState.RED, 5.0),
    }
    for time, (state, remaining) in expected.items():
        shown = show(program, jnp.asarray(time))
        assert int(shown.state[0]) == state
        np.testing.assert_allclose(shown.remaining[0], remaining, rtol=1e-5)
        assert bool(shown.valid[0])


def test_phases_are_never_green_together():
    program = alternating(4)
    for time in np.arange(0.0, 120.0, 0.5):
        state = np.asarray(show(program, jnp.asarray(time)).state)
        moving = state != SignalState.RED
        assert not (moving[0] and moving[1])
        assert state[0] == state[2]
        assert state[1] == state[3]


def test_no_signals():
    assert show(alternating(0), jnp.asarray(3.0)).state.shape == (0,)


def at(cycle, time):
    """What a cycle shows, phase after phase from its offset on, and for how long, over as many rounds as it takes."""
    edges = cycle.offset + np.concatenate([[0], np.cumsum(cycle.duration * 60)]) - 25 * sum(cycle.duration)
    states = np.array([GREEN if state == OFF else state for state in cycle.state * 60])
    now = int(np.searchsorted(edges, time + 1e-6, side="right")) - 1
    until = now + 1
    while until < len(states) and states[until] == states[now]:
        until += 1
    return states[now], edges[until] - time if until < len(states) else np.inf


def test_any_sequence_of_phases_is_shown_as_it_is_stated():
    rng = np.random.default_rng(0)
    cycles = []
    for _ in range(40):
        count = int(rng.integers(1, 8))
        lasts = tuple((rng.integers(0, 60, count) / 10).tolist())
        if sum(lasts) >= 2:
            cycles.append(
                SignalCycle(lasts, tuple(rng.integers(0, 4, count).tolist()), float(rng.integers(0, 400) / 10))
            )
    shows = jax.jit(jax.vmap(lambda time: show(phases(cycles, len(cycles)), time)))
    times = np.arange(0, 30, 0.1)
    found = shows(jnp.asarray(times, jnp.float32))
    for g, cycle in enumerate(cycles):
        state, left = zip(*(at(cycle, time) for time in times), strict=True)
        np.testing.assert_array_equal(found.state[:, g], state, err_msg=str(cycle))
        np.testing.assert_allclose(found.remaining[:, g], left, atol=1e-4, err_msg=str(cycle))


def test_red_yellow_is_one_red_and_a_green_goes_on_round_the_cycle():
    cycle = SignalCycle((5.0, 20.0, 1.0, 10.0, 3.0, 9.0), (GREEN, RED, RED, GREEN, YELLOW, GREEN), offset=2.0)
    program = phases([cycle], 1)
    assert program.phase.tolist() == [[GREEN, RED, GREEN, YELLOW]]
    for time, state, left in ((0.0, GREEN, 7.0), (8.0, RED, 20.0), (30.0, GREEN, 8.0), (42.0, GREEN, 13.0)):
        shown = show(program, jnp.asarray(time))
        assert int(shown.state[0]) == state
        assert float(shown.remaining[0]) == pytest.approx(left, abs=1e-4)


def test_the_same_cycle_is_shown_alike_by_both_kinds_of_program():
    cycle = SignalCycle((30.0, 3.0, 27.0), (GREEN, YELLOW, RED), offset=10.0)
    plain = SignalProgram(*(jnp.asarray([x]) for x in (60.0, 10.0, 0.5, 3.0)))
    for time in np.arange(0.05, 130, 0.7):
        one, other = (show(program, jnp.asarray(time)) for program in (plain, phases([cycle], 1)))
        assert int(one.state[0]) == int(other.state[0])
        np.testing.assert_allclose(one.remaining, other.remaining, atol=1e-4)


def test_without_a_program_a_signal_is_green_for_good():
    dark = SignalCycle((4.0, 6.0), (OFF, OFF))
    program = phases([None, dark, SignalCycle((4.0, 6.0), (RED, OFF))], 4)
    assert list(map(stated, (None, dark, SignalCycle((4.0,), (RED,))))) == [False, False, True]
    for time, third in ((1.0, RED), (5.0, GREEN)):
        shown = show(program, jnp.asarray(time))
        assert shown.state.tolist() == [GREEN, GREEN, third, GREEN]
        assert np.isposinf(np.asarray(shown.remaining)[[0, 1, 3]]).all()
    assert show(phases([], 0), jnp.asarray(3.0)).state.shape == (0,)


@pytest.mark.parametrize("cycle", [((1.0,), (RED, GREEN)), ((0.0, 0.0), (RED, GREEN)), ((2.0, -1.0), (RED, GREEN))])
def test_what_is_no_cycle_is_named(cycle):
    with pytest.raises(ScenarioError, match="the cycle of signal 1 has the durations"):
        phases([None, SignalCycle(*cycle)], 2)
