import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.geometry import frenet

SPACING, RADIUS = 2.0, 25.0


def arc(n=16, start=3.0):
    """Position, heading and curvature of a left-hand circle at uniform stations that begin at `start`."""
    angle = np.arange(n) * SPACING / RADIUS
    position = RADIUS * np.stack([np.sin(angle), 1 - np.cos(angle)], -1)
    return jnp.asarray(position), jnp.asarray(angle), jnp.full(n, 1 / RADIUS)


@jax.jit
def sample(line, station):
    position, heading, curvature = line
    return frenet.sample(position, heading, curvature=curvature, start=3.0, spacing=SPACING, station=station)


offset_curve = jax.jit(frenet.offset_curve)


def test_sampling_a_circle_stays_on_it(x64):
    station = jnp.linspace(3.0, 33.0, 101)
    found = sample(arc(), station)
    angle = (station - 3.0) / RADIUS
    exact = RADIUS * np.stack([np.sin(angle), 1 - np.cos(angle)], -1)
    np.testing.assert_allclose(found.position, exact, atol=3e-6)  # h^4 kappa^3 / 384 and its like
    np.testing.assert_allclose(found.heading, angle, atol=1e-12)
    np.testing.assert_allclose(found.curvature, 1 / RADIUS, atol=1e-12)


def test_grid_points_are_returned_exactly(x64):
    position, heading, curvature = arc()
    found = sample((position, heading, curvature), 3.0 + SPACING * jnp.arange(16.0))
    np.testing.assert_allclose(found.position, position, atol=1e-12)
    np.testing.assert_allclose(found.heading, heading, atol=1e-12)


def test_position_is_continuously_differentiable_with_the_headings_as_tangents(x64):
    line = arc()
    tangent = jax.jit(jax.vmap(jax.jacfwd(lambda s: sample(line, s).position)))
    knots = 3.0 + SPACING * jnp.arange(1.0, 15.0)
    for side in (-1e-9, 1e-9):
        expected = np.stack([np.cos(line[1][1:15]), np.sin(line[1][1:15])], -1)
        np.testing.assert_allclose(tangent(knots + side), expected, atol=1e-7)


@pytest.mark.parametrize(
    ("station", "index", "fraction", "beyond"), [(1.0, 0, 0.0, -2.0), (6.0, 1, 0.5, 0.0), (11.0, 2, 1.0, 2.0)]
)
def test_cells_of_the_grid(station, index, fraction, beyond):
    found = frenet.cell(3.0, SPACING, n=4, station=jnp.asarray(station))
    np.testing.assert_allclose([float(v) for v in found], [index, fraction, beyond])


def test_beyond_the_ends_the_line_goes_straight_on(x64):
    line = arc()
    found = sample(line, jnp.array([-2.0, 43.0]))
    end = np.asarray(line[0][-1]) + 10 * np.array([np.cos(line[1][-1]), np.sin(line[1][-1])])
    np.testing.assert_allclose(found.position, [[-5.0, 0.0], end], atol=1e-9)
    np.testing.assert_allclose(found.heading, line[1][jnp.array([0, -1])], atol=1e-12)
    np.testing.assert_array_equal(found.curvature, [0, 0])


def test_everything_is_continuous_in_the_station(x64):
    found = sample(arc(), jnp.linspace(-2, 40, 42_001))
    for value, slope in ((found.position[:, 0], 1.1), (found.heading, 0.05), (found.curvature, 0.021)):
        assert np.abs(np.diff(value)).max() < slope * 1e-3


def test_queries_of_any_shape(x64):
    line = arc()
    assert sample(line, jnp.asarray(4.0)).position.shape == (2,)
    found = sample(line, jnp.full((2, 3), 4.0))
    assert found.position.shape == (2, 3, 2)
    assert found.heading.shape == (2, 3)


def test_offset_of_a_circle_is_a_circle(x64):
    heading, curvature = offset_curve(
        jnp.array([0.3]), jnp.array([0.1]), offset=jnp.array([4.0]), slope=jnp.zeros(1), bend=jnp.zeros(1)
    )
    np.testing.assert_allclose([heading[0], curvature[0]], [0.3, 1 / 6], rtol=1e-12)


def test_offset_curve_equals_the_differentiated_curve(x64):
    """On a reference of heading a s + b s^2 with d = wave(s), from derivatives of the curve itself."""
    a, b = 0.02, 0.003

    def wave(s):
        return 1.5 * jnp.sin(0.3 * s) + 0.1 * s

    def tangent(angle):
        return jnp.stack([jnp.cos(angle), jnp.sin(angle)])

    def velocity(s):  # of the offset curve: (1 - kappa d) t + d' n, from the Frenet equations
        angle = a * s + b * s * s
        return (1 - (a + 2 * b * s) * wave(s)) * tangent(angle) + jax.grad(wave)(s) * tangent(angle + jnp.pi / 2)

    s = jnp.linspace(0, 8, 9)
    v, dv = jax.vmap(velocity)(s), jax.vmap(jax.jacfwd(velocity))(s)
    speed = np.linalg.norm(v, axis=1)
    heading, curvature = offset_curve(
        a * s + b * s * s,
        a + 2 * b * s,
        offset=wave(s),
        slope=jax.vmap(jax.grad(wave))(s),
        bend=jax.vmap(jax.grad(jax.grad(wave)))(s),
        curvature_slope=jnp.full(9, 2 * b),
    )
    np.testing.assert_allclose(np.exp(1j * heading), (v[:, 0] + 1j * v[:, 1]) / speed, atol=1e-12)
    np.testing.assert_allclose(curvature, (v[:, 0] * dv[:, 1] - v[:, 1] * dv[:, 0]) / speed**3, atol=1e-12)
    np.testing.assert_allclose(
        frenet.offset_length(a + 2 * b * s, wave(s), slope=jax.vmap(jax.grad(wave))(s)), speed, atol=1e-12
    )


def test_to_world_offsets_to_the_left():
    reference = frenet.Reference(jnp.array([1.0, 2.0]), jnp.asarray(jnp.pi / 2), jnp.asarray(0.0))
    np.testing.assert_allclose(frenet.to_world(reference, jnp.asarray(3.0)), [-2, 2], atol=1e-6)


def test_mirror_changes_the_signs_only(x64):
    numbers = {"heading": 0.4, "curvature": 0.05, "offset": 2.0, "slope": 0.3, "bend": -0.1, "curvature_slope": 0.01}
    heading, curvature = offset_curve(**{name: jnp.array([v]) for name, v in numbers.items()})
    mirrored_heading, mirrored_curvature = offset_curve(**{name: jnp.array([-v]) for name, v in numbers.items()})
    np.testing.assert_allclose([mirrored_heading, mirrored_curvature], [-heading, -curvature], rtol=1e-12)


def test_gradients_are_finite_at_and_beyond_the_centre_of_curvature():
    def value(kappa, d, slope):
        return jnp.sum(jnp.stack(frenet.offset_curve(jnp.zeros_like(d), kappa, offset=d, slope=slope, bend=slope)))

    for d in (0.0, 10.0, 12.0):
        arguments = (jnp.asarray(0.1), jnp.asarray(d), jnp.asarray(0.0))
        assert np.isfinite(value(*arguments))
        assert np.isfinite(jax.grad(value, argnums=(0, 1, 2))(*arguments)).all()
