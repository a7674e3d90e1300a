import jax.numpy as jnp
import numpy as np

from urbanjax.sim.signals import SignalProgram, alternating, show
from urbanjax.types import SignalState


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
