import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from urbanjax.planning.resample import arc_length_splines

splines = jax.jit(arc_length_splines)


@pytest.fixture
def paths(x64):
    """Two wavy paths of unevenly spaced points, [J, K, 2], with the headings of their curves."""
    t = np.cumsum(np.random.default_rng(1).uniform(0.5, 1.5, 20))
    rows, headings = [], []
    for amplitude in (2.0, -1.0):
        rows.append(np.stack([t + 500.0, amplitude * np.sin(t / 4)], axis=-1))
        headings.append(np.arctan(amplitude / 4 * np.cos(t / 4)))
    return jnp.asarray(np.array(rows)), jnp.asarray(np.array(headings))


def test_splines_are_the_clamped_cubic_splines_over_chord_length(paths):
    position, heading = paths
    found_heading, found_curvature = splines(position, heading)
    for j in range(2):
        points, h = np.asarray(position[j]), np.asarray(heading[j])
        s = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        ends = tuple((1, np.array([np.cos(h[i]), np.sin(h[i])])) for i in (0, -1))
        oracle = CubicSpline(s, points, bc_type=ends)
        (dx, dy), (ax, ay) = oracle(s, 1).T, oracle(s, 2).T
        np.testing.assert_allclose(found_heading[j], np.arctan2(dy, dx), atol=1e-9)
        np.testing.assert_allclose(found_curvature[j], (dx * ay - dy * ax) / np.hypot(dx, dy) ** 3, atol=1e-9)


def test_splines_come_near_the_curve(paths):
    position, heading = paths
    found_heading, _ = splines(position, heading)
    np.testing.assert_allclose(found_heading, heading, atol=5e-3)


def test_whole_turns_of_the_heading_are_kept(paths):
    position, heading = paths
    turned, _ = splines(position, heading + 4 * jnp.pi)
    plain, _ = splines(position, heading)
    np.testing.assert_allclose(turned, plain + 4 * np.pi, atol=1e-9)


def test_coincident_points_are_finite():
    def total(position):
        return sum(jnp.sum(x) for x in arc_length_splines(position, jnp.zeros((1, 5))))

    value, slope = jax.jit(jax.value_and_grad(total))(jnp.zeros((1, 5, 2)))
    assert np.isfinite(value)
    assert np.all(np.isfinite(slope))
