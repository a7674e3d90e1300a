"""Planned ways among forecasts: which contact counts, and when; boxes are 4 m by 2 m."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.traffic.safety.scenes import drive, objects, pick, random_objects
from urbanjax.traffic.safety.faults import BlameParams, first_infractions, forecast, touching

DT, COUNT, AXLE = 0.1, 41, 1.4
TIMES = jnp.asarray(DT * np.arange(COUNT), jnp.float32)


@pytest.fixture(scope="module")
def judge():
    """Times of the first fault and the first nearness of one way among others, in and apart from its lane."""

    @jax.jit
    def run(own, others):
        def both(apart):
            given = dict(times=TIMES, axle=AXLE, apart=jnp.full((1, COUNT), apart), params=BlameParams())
            return tuple(when[0] for when in first_infractions(own, others, **given))

        return both(False), both(True)

    def found(speed, position, heading, their_speed, valid=True):
        own = jax.tree.map(lambda x: x[None], pick(drive(objects([[0, 0]], [0.0], speed), COUNT, DT), slice(None), 0))
        other = objects([position], [heading], their_speed, valid=valid)
        return np.array(run(own, forecast(other, TIMES)))

    return found


def test_forecasts_go_straight_on():
    start = random_objects(np.random.default_rng(0), (5,))
    tracks, found = drive(start, COUNT, DT), forecast(start, TIMES)
    np.testing.assert_allclose(found.position, tracks.position, atol=1e-3)
    np.testing.assert_array_equal(found.heading[-1], start.heading)


def test_touching_counts_who_is_there():
    one = objects([0, 0], 0.0, 0.0)
    pairs = objects([[3.9, 0], [4.1, 0], [0, 1.9], [3.9, 0]], [0.0] * 4, 0.0, valid=[True, True, True, False])
    np.testing.assert_array_equal(jax.vmap(touching, (None, 0))(one, pairs), [True, False, True, False])


@pytest.mark.parametrize(
    ("case", "within", "apart"),
    [
        # The gap of 10 m is closed after 1 s at 10 m/s, and 0.9 s earlier it is near.
        ((10.0, (14.0, 0.0), 0.0, 0.0), (1.0, 0.1), (1.0, 0.1)),  # what stands
        ((10.0, (14.0, 0.0), 0.0, 5.0), (2.0, 1.1), (2.0, 1.1)),  # who is slower ahead
        ((0.0, (14.0, 0.0), np.pi, 10.0), (np.inf, np.inf), (np.inf, np.inf)),  # one stands
        ((5.0, (-14.0, 0.0), 0.0, 15.0), (np.inf, np.inf), (np.inf, np.inf)),  # from behind
        # Into the flank from 90 degrees: 4 m between the sides, 1 s at 4 m/s.
        ((5.0, (5.0, 6.0 + 1.0), -np.pi / 2, 4.0), (np.inf, np.inf), (1.0, 0.1)),
        ((10.0, (14.0, 3.0), 0.0, 0.0), (np.inf, np.inf), (np.inf, np.inf)),  # passed by
    ],
)
def test_whose_fault_and_when(judge, case, within, apart):
    np.testing.assert_allclose(judge(*case), [within, apart], atol=0.11)


def test_who_is_absent_is_not_met(judge):
    assert np.isinf(judge(10.0, (14.0, 0.0), 0.0, 0.0, valid=False)).all()
