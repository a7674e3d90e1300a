import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from urbanjax.geometry import spline

fit, fit_path = jax.jit(spline.fit), jax.jit(spline.fit_path, static_argnames="natural")
evaluate, evaluate_path = jax.jit(spline.evaluate), jax.jit(spline.evaluate_path)


def knots(seed=0, n=9):
    rng = np.random.default_rng(seed)
    return (
        np.concatenate([[2.0], 2.0 + np.cumsum(rng.uniform(0.2, 3, n - 1))]),
        rng.normal(size=(n, 2)),
        rng.normal(size=(2, 2)),
    )


@pytest.mark.parametrize("n", [2, 3, 9])
@pytest.mark.parametrize("boundary", ["clamped", "natural"])
def test_equals_scipy(x64, n, boundary):
    station, value, slopes = knots(n=n)
    found = fit(
        jnp.asarray(station), jnp.asarray(value), end_slopes=jnp.asarray(slopes) if boundary == "clamped" else None
    )
    ends = ((1, slopes[0]), (1, slopes[1])) if boundary == "clamped" else "natural"
    peer = CubicSpline(station, value, bc_type=ends)
    query = np.linspace(station[0], station[-1], 57)
    for order, ours in enumerate(evaluate(found, query)):
        np.testing.assert_allclose(ours, peer(query, order), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("boundary", ["clamped", "natural"])
def test_repeated_knots_change_nothing(x64, boundary):
    station, value, slopes = knots(seed=1)
    ends = jnp.asarray(slopes) if boundary == "clamped" else None
    index = np.repeat(np.arange(9), [3, 1, 2, 1, 1, 4, 1, 1, 5])
    query = np.concatenate([station, np.linspace(station[0] - 1, station[-1] + 1, 40)])
    expected = evaluate(fit(jnp.asarray(station), jnp.asarray(value), end_slopes=ends), query)
    found = evaluate(fit(jnp.asarray(station[index]), jnp.asarray(value[index]), end_slopes=ends), query)
    for ours, plain in zip(found, expected, strict=True):
        np.testing.assert_allclose(ours, plain, atol=1e-9)


def test_value_slope_and_bend_are_continuous_across_knots(x64):
    station, value, slopes = knots(seed=2)
    fitted = fit(jnp.asarray(station), jnp.asarray(value), end_slopes=jnp.asarray(slopes))
    for before, after in zip(
        evaluate(fitted, station[1:-1] - 1e-10), evaluate(fitted, station[1:-1] + 1e-10), strict=True
    ):
        np.testing.assert_allclose(before, after, atol=1e-7)


def test_passes_through_its_knots_with_the_given_end_slopes():
    station, value, slopes = (jnp.asarray(v, jnp.float32) for v in knots(seed=3))
    on, slope, _ = evaluate(fit(station, value, end_slopes=slopes), station)
    np.testing.assert_allclose(on, value, atol=1e-5)
    np.testing.assert_allclose(slope[jnp.array([0, -1])], slopes, atol=1e-4)


def test_beyond_its_ends_it_goes_straight_on(x64):
    station, value, slopes = knots(seed=4)
    fitted = fit(jnp.asarray(station), jnp.asarray(value), end_slopes=jnp.asarray(slopes))
    on, slope, bend = evaluate(fitted, jnp.array([station[0] - 2, station[-1] + 3]))
    np.testing.assert_allclose(on, value[[0, -1]] + np.array([[-2.0], [3.0]]) * slopes, atol=1e-9)
    np.testing.assert_allclose(slope, slopes, atol=1e-9)
    np.testing.assert_array_equal(bend, np.zeros((2, 2)))


def test_a_circle_keeps_its_heading_and_curvature(x64):
    angle = np.linspace(0, 1.5, 16)
    points = 30 * np.stack([np.sin(angle), 1 - np.cos(angle)], -1)
    fitted = fit_path(jnp.asarray(points))
    position, heading, curvature = evaluate_path(fitted, np.linspace(0, fitted.station[-1], 80))
    np.testing.assert_allclose(np.linalg.norm(position - np.array([[0, 30]]), axis=1), 30, atol=1e-4)
    np.testing.assert_allclose(curvature, 1 / 30, rtol=5e-3)
    np.testing.assert_allclose(heading[jnp.array([0, -1])], [0, 1.5], atol=1e-9)


def test_path_is_invariant_under_motion(x64):
    points = np.cumsum(np.random.default_rng(5).uniform(0, 2, (8, 2)), axis=0)
    rotation = np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]])
    query = np.linspace(0, 8, 20)
    for natural in (False, True):
        position, heading, curvature = evaluate_path(fit_path(jnp.asarray(points), natural=natural), query)
        moved = evaluate_path(fit_path(jnp.asarray(points @ rotation.T + 7), natural=natural), query)
        np.testing.assert_allclose(moved[0], position @ rotation.T + 7, atol=1e-9)
        np.testing.assert_allclose(moved[1], heading + 0.5, atol=1e-9)
        np.testing.assert_allclose(moved[2], curvature, atol=1e-9)


def test_headings_given_for_the_ends_are_kept(x64):
    points = jnp.array([[0.0, 0.0], [4.0, 0.5], [9.0, 0.0]])
    fitted = fit_path(points, jnp.array([-0.3, 0.2]))
    _, heading, _ = evaluate_path(fitted, jnp.array([0.0, fitted.station[-1]]))
    np.testing.assert_allclose(heading, [-0.3, 0.2], atol=1e-9)


def test_gradients_equal_finite_differences(x64):
    station, value, slopes = knots(seed=6)
    rng = np.random.default_rng(6)
    directions = [rng.normal(size=np.shape(v)) for v in (station, value, slopes)]
    query = np.linspace(station[0], station[-1], 10)[1:-1]

    @jax.jit
    def moved(step):
        at, values, ends = (v + step * d for v, d in zip((station, value, slopes), directions, strict=True))
        return jnp.stack(spline.evaluate(spline.fit(at, values, end_slopes=ends), jnp.asarray(query)))

    _, slope = jax.jvp(moved, (0.0,), (1.0,))
    expected = (moved(1e-6) - moved(-1e-6)) / 2e-6
    np.testing.assert_allclose(slope, expected, rtol=1e-5, atol=1e-5)


@functools.partial(jax.jit, static_argnums=1)
@jax.value_and_grad
def everything(points, natural):
    parts = spline.evaluate_path(spline.fit_path(points, natural=natural), jnp.array([-1.0, 0.0, 1.0, 2.0, 3.0]))
    return sum(jnp.sum(part) for part in parts)


@pytest.mark.parametrize("natural", [False, True])
@pytest.mark.parametrize("points", [[[1.0, 1.0]] * 4, [[0.0, 0.0], [0.0, 0.0], [2.0, 0.0], [2.0, 0.0]]])
def test_degenerate_paths_are_finite_in_value_and_gradient(natural, points):
    value, slope = everything(jnp.asarray(points), natural)
    assert np.isfinite(value)
    assert np.isfinite(slope).all()
