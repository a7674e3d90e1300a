import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.geometry.polyline import curvatures, headings
from urbanjax.planning import quintic
from urbanjax.planning.cross_section import cross_sections
from urbanjax.planning.primitives import end_states
from urbanjax.vehicle.params import VehicleParams

SLOW_LEADER = (50.0, 0.0, 3.0)
CURVED = {"curvature": 0.012}


@pytest.fixture
def fan(planner, scenes):
    """A fan from a state that is off the centre, turned, steered and braking."""
    window = scenes.road(**CURVED)
    ego = scenes.ego(window, offset=0.3, turned=0.05, speed=8.0, steering=0.08, acceleration=-0.7)
    return (ego, *planner(window, ego, scenes.traffic(window, [SLOW_LEADER])))


def test_quintics_solve_the_printed_system(scenes, x64):
    window = scenes.road(**CURVED)
    _, state = scenes.ego(window, offset=0.3, turned=0.05, speed=8.0, steering=0.08, acceleration=-0.7)
    n = 4
    end = quintic.EndState(
        station=20.0 + jnp.array([16.0, 20.0, 24.0, 33.0]),
        length=jnp.array([16.0, 20.0, 24.0, 33.0]),
        duration=jnp.array([2.0, 2.5, 3.0, 4.5]),
        beside=jnp.zeros(n),
        speed=jnp.array([8.0, 8.0, 8.0, 6.0]),
        acceleration=jnp.array([0.0, 0.5, 0.0, -0.8]),
        offset=jnp.array([0.0, 1.0, -1.0, 3.5]),
        slope=jnp.array([0.0, 0.1, -0.05, 0.0]),
        bend=jnp.array([0.0, 0.01, 0.0, -0.01]),
    )
    at_end = cross_sections(window, end.station)
    curvature = jnp.tan(state.steering) / 2.8
    found = quintic.coefficients(state, curvature, end=end, at_end=at_end)
    kappa, theta = float(curvature), float(state.heading)
    for j in range(n):
        t = float(end.duration[j])
        rows = [np.polynomial.polynomial.polyvander([s], 5)[0] for s in (0.0, t)]
        first = [np.array([k * s ** max(k - 1, 0) for k in range(6)]) for s in (0.0, t)]
        second = [np.array([k * (k - 1) * s ** max(k - 2, 0) for k in range(6)]) for s in (0.0, t)]
        matrix = np.stack([rows[0], first[0], second[0], rows[1], first[1], second[1]])
        heading, kappa_end = quintic.shape.to_plane(
            at_end.heading[j], at_end.curvature[j], end.offset[j], end.slope[j], end.bend[j]
        )
        v, w, a = 8.0, float(end.speed[j]), float(end.acceleration[j])
        target, _ = scenes.place(window, float(end.station[j]), float(end.offset[j]))
        target = target - np.asarray(state.position)
        for c, trig in ((0, (np.cos, lambda h: -np.sin(h))), (1, (np.sin, np.cos))):
            right = [
                0.0,
                v * trig[0](theta),
                -0.7 * trig[0](theta) + v * v * kappa * trig[1](theta),
                target[c],
                w * trig[0](heading),
                a * trig[0](heading) + w * w * kappa_end * trig[1](heading),
            ]
            expected = np.linalg.solve(matrix, np.array(right, float))
            # The hermite reference line is within a hair of the circle.
            np.testing.assert_allclose(found[j, :, c] / t ** np.arange(6), expected, atol=1e-5)


def test_candidates_start_with_the_vehicle(fan):
    (_, state), _, fan, _ = fan
    expected = jnp.tan(state.steering) / VehicleParams().wheelbase
    np.testing.assert_allclose(fan.position[:, 0], np.broadcast_to(state.position, fan.position[:, 0].shape), atol=2e-3)
    np.testing.assert_allclose(fan.heading[:, 0], state.heading, atol=1e-3)
    np.testing.assert_allclose(fan.curvature[:, 0], expected, atol=1e-3)
    np.testing.assert_allclose(fan.speed[:, 0], state.speed, rtol=1e-3)
    np.testing.assert_allclose(fan.time[:, 0], 0, atol=2e-3)


def test_heading_and_curvature_are_those_of_the_points(fan):
    _, _, fan, _ = fan
    for j in range(fan.offset.shape[0]):
        points = fan.position[j]
        np.testing.assert_allclose(headings(points)[1:-1], fan.heading[j, 1:-1], atol=0.02)
        np.testing.assert_allclose(curvatures(points)[2:-2], fan.curvature[j, 2:-2], atol=0.02)


def test_curvature_is_continuous_where_the_quintic_ends(planner, scenes, params):
    """Halving the spacing halves the largest step of the curvature: a jump would stay."""
    window = scenes.road(**CURVED)
    ego = scenes.ego(window, offset=0.3, turned=0.05, speed=8.0, steering=0.08)
    cars = scenes.traffic(window, [SLOW_LEADER])
    steps = []
    for horizon in (6.0, 3.0):
        fine = params.replace(primitives=params.primitives.replace(path_horizon=horizon, min_spacing=0.2))
        _, fan, _ = planner(window, ego, cars, fine)
        inside = np.asarray(fan.station) < 20 + 8.0 * 3.0
        steps.append(np.abs(np.diff(np.asarray(fan.curvature)[:, inside], axis=1)).max())
    assert steps[1] < 0.6 * steps[0]


def test_all_candidates_pass_the_same_stations_in_order(fan):
    _, _, fan, _ = fan
    assert np.all(np.diff(fan.time, axis=1) > 0)
    left = np.stack([-np.sin(fan.road.heading), np.cos(fan.road.heading)], axis=-1)
    away = np.asarray(fan.position) - np.asarray(fan.road.position)[None]
    np.testing.assert_allclose(np.sum(away * left[None], -1), fan.offset, atol=1e-3)
    along = np.stack([np.cos(fan.road.heading), np.sin(fan.road.heading)], axis=-1)
    assert np.abs(np.sum(away * along[None], -1)).max() < 2e-3


def test_end_states_are_reached(fan, params):
    (_, state), macro, fan, _ = fan
    end = end_states(state, macro, params=params.primitives)
    for j in range(fan.offset.shape[0]):
        if end.station[j] < fan.station[-1]:
            assert np.interp(end.station[j], fan.station, fan.offset[j]) == pytest.approx(
                float(end.offset[j]), abs=0.02
            )
            assert np.interp(end.station[j], fan.station, fan.time[j]) == pytest.approx(
                float(end.duration[j]), abs=0.02
            )
            assert np.interp(end.station[j], fan.station, fan.speed[j]) == pytest.approx(float(end.speed[j]), abs=0.1)


def test_candidates_return_to_the_macro_plan(fan):
    _, _, fan, _ = fan
    np.testing.assert_allclose(fan.offset[:3, -1], fan.macro_offset[-1], atol=1e-3)


def test_the_fan_varies_smoothly_with_speed_down_to_standstill(planner, scenes):
    window = scenes.road(**CURVED)
    cars = scenes.traffic(window, [])
    speeds = np.arange(0.0, 4.0, 0.05)
    fans = [planner(window, scenes.ego(window, offset=0.5, speed=v, steering=0.05), cars)[1] for v in speeds]
    for name in ("offset", "curvature", "speed"):
        values = np.stack([np.asarray(getattr(f, name))[:, 1:] for f in fans])
        assert np.all(np.isfinite(values))
        steps = np.abs(np.diff(values, axis=0)).max(axis=(1, 2))
        assert steps.max() < {"offset": 0.05, "curvature": 0.03, "speed": 0.2}[name]


def test_below_the_low_speed_the_offset_is_a_quintic_of_station(planner, scenes):
    window = scenes.road()
    _, fan, _ = planner(window, scenes.ego(window, offset=0.8, speed=0.5), scenes.traffic(window, []))
    j = int(np.argmax((fan.end.beside == 0) & (fan.end.length > 9)))
    u = np.clip((np.asarray(fan.station) - 20) / float(fan.end.length[j]), 0, 1)
    start, end, inside = 0.8, float(fan.end.offset[j]), u < 1
    assert fan.end.slope[j] == fan.end.bend[j] == 0
    expected = start + (end - start) * u**3 * (10 - 15 * u + 6 * u**2)
    np.testing.assert_allclose(np.asarray(fan.offset[j])[inside], expected[inside], atol=1e-4)


def test_splines_through_the_points_agree_with_the_quintics(planner, scenes, params):
    window = scenes.road(**CURVED)
    ego, cars = scenes.ego(window, offset=0.3, speed=8.0, steering=0.03), scenes.traffic(window, [])
    smooth = params.replace(primitives=params.primitives.replace(resampling="spline", path_horizon=4.0))
    exact = params.replace(primitives=params.primitives.replace(path_horizon=4.0))
    (_, a, near), (_, b, _) = planner(window, ego, cars, exact), planner(window, ego, cars, smooth)
    np.testing.assert_allclose(a.position, b.position, rtol=1e-6, atol=1e-5)  # two programs: rounding differs
    j = near.chosen
    np.testing.assert_allclose(a.heading[j], b.heading[j], atol=2e-3)
    np.testing.assert_allclose(a.curvature[j], b.curvature[j], atol=2e-3)


def test_the_derivative_of_polynomials_is_the_next_one(x64):
    rng = np.random.default_rng(0)
    c, share = jnp.asarray(rng.normal(size=(3, 6, 2))), jnp.asarray(rng.uniform(size=(3, 5)))
    along = jnp.asarray(rng.normal(size=c.shape)), jnp.asarray(rng.normal(size=share.shape))

    def horner(c, share):
        value, *derivatives = (sum(c[:, None, i] * share[..., None] ** i for i in range(6)),)
        for order in (1, 2):
            factors = [np.prod([i - k for k in range(order)]) for i in range(6)]
            derivatives.append(
                sum(factors[i] * c[:, None, i] * share[..., None] ** (i - order) for i in range(order, 6))
            )
        return jnp.stack([value, *derivatives], axis=-1)

    for found, expected in zip(*(jax.jvp(f, (c, share), along) for f in (quintic.read, horner)), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-10)
