"""Candidates over a grid of Frenet end states: motions, relations in the plane, costs, limits and the choice."""

import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from urbanjax.numerics.soft import Relaxation
from urbanjax.planning.frenet import choice, limits
from urbanjax.planning.frenet.choice import FRENET_TERMS, FrenetParams
from urbanjax.planning.frenet.fan import FIELDS, generate
from urbanjax.planning.frenet.limits import FRENET_LIMITS
from urbanjax.planning.frenet.line import along_route, look_up, reference_line
from urbanjax.planning.frenet.motion import EndGrid, FrenetState
from urbanjax.types import Prediction, as_arrays
from urbanjax.vehicle.params import VehicleParams

OFFSETS, SPEEDS, ACCELERATIONS, DURATIONS = (-1.5, 0.0, 1.5), (6.0, 12.0), (0.0, 1.0), (1.0, 2.0)
START = (10.0, 9.0, 0.4), (0.5, 0.3, -0.2)
WISH = 10.0
VEHICLE = VehicleParams()


def grid(**changes) -> EndGrid:
    return EndGrid(OFFSETS, SPEEDS, ACCELERATIONS, DURATIONS, n_times=26).replace(**changes)


def curved(station, sign=1.0):
    """Heading and curvature of a winding line."""
    return sign * 0.6 * (1 - np.cos(station / 20)), sign * 0.03 * np.sin(station / 20)


def circular(curvature):
    return lambda station: (curvature * station, curvature + 0 * station)


@functools.cache
def place(shape):
    """Position [m] as a function of the station, integrated finely."""
    fine = np.linspace(-5, 120, 25001)
    angle = shape(fine)[0]
    direction = np.stack([np.cos(angle), np.sin(angle)], 1)
    spline = CubicSpline(fine, direction).antiderivative()
    return lambda station: spline(station) - spline(0.0)


def line_of(shape, spacing=0.5, length=80.0):
    station = np.arange(0.0, length + spacing / 2, spacing)
    heading, curvature = shape(station)
    arrays = (jnp.asarray(v, float) for v in (place(shape)(station), heading, curvature))
    return reference_line(*arrays, jnp.asarray(0.0), jnp.asarray(spacing))


def state(station=START[0], offset=START[1]) -> FrenetState:
    return as_arrays(FrenetState(jnp.array(station), jnp.array(offset)))


def scene_params(**changes) -> FrenetParams:
    return as_arrays(FrenetParams(grid=grid(**changes)))


@functools.cache
def compiled(function):
    return jax.jit(function)


def fan_of(line, begin, ends):
    return compiled(generate)(line, begin, as_arrays(ends))


def plan_of(line, begin=None, prediction=None, params=None, mode="hard", temperature=0.1, wish=WISH):
    relaxation = as_arrays(Relaxation(temperature, mode=mode))
    begin = state() if begin is None else begin
    params = scene_params() if params is None else params
    return compiled(choice.plan)(line, begin, jnp.asarray(wish), prediction, as_arrays(VEHICLE), params, relaxation)


def solved(start, end, time, order):
    """Polynomial through derivatives 0, 1, 2 at 0 and (derivative, value) pairs at `time`, by linear equations."""
    rows, values = [], []
    for at, conditions in ((0.0, list(enumerate(start))), (time, end)):
        for derivative, value in conditions:
            rows.append([np.polynomial.Polynomial.basis(i).deriv(derivative)(at) for i in range(order + 1)])
            values.append(value)
    return np.polynomial.Polynomial(np.linalg.solve(np.array(rows), np.array(values)))


def motions(begin=START, lateral="time"):
    """Station and offset over time of every candidate, in the order of the fan, from their definition."""
    for d, v, a, n in itertools.product(OFFSETS, SPEEDS, ACCELERATIONS, DURATIONS):
        s = solved(begin[0], [(1, v), (2, a)], n, 4)
        if lateral == "time":
            across = solved(begin[1], [(0, d), (1, 0.0), (2, 0.0)], n, 5)
            yield n, s, across, across
        else:
            slope = begin[1][1] / begin[0][1]
            bend = (begin[1][2] - slope * begin[0][2]) / begin[0][1] ** 2
            across = solved((begin[1][0], slope, bend), [(0, d), (1, 0.0), (2, 0.0)], s(n) - s(0.0), 5)
            yield n, s, across, lambda t, across=across, s=s: across(s(t) - s(0.0))


def each(values):
    """[.., D, V * A, N, T] -> [.., candidates, T] in double precision."""
    values = np.asarray(values, float)
    return values.reshape(*values.shape[:-4], -1, values.shape[-1])


@pytest.mark.parametrize(("lateral", "begin"), [("time", START), ("station", ((10.0, 3.0, 0.4), (0.5, 0.2, -0.1)))])
def test_relations_are_the_derivatives_of_the_positions(x64, lateral, begin):
    fan = fan_of(line_of(curved, spacing=0.02), state(*begin), grid(lateral=lateral))
    values = dict(zip(FIELDS, each(fan.values), strict=True))
    time, small = 0.1 * np.arange(26), 1e-3
    for i, (end, s, _, d) in enumerate(motions(begin, lateral)):
        known = time < end - 2 * small

        def position(t, s=s, d=d):
            angle = curved(s(t))[0]
            return place(curved)(s(t)) + d(t)[:, None] * np.stack([-np.sin(angle), np.cos(angle)], 1)

        now, before, after = (position(time[known] + k * small) for k in (0, -1, 1))
        velocity, change = (after - before) / (2 * small), (after - 2 * now + before) / small**2
        speed = np.hypot(*velocity.T)
        wanted = {
            "x": now[:, 0],
            "y": now[:, 1],
            "heading": np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0])),
            "speed": speed,
            "curvature": (velocity[:, 0] * change[:, 1] - velocity[:, 1] * change[:, 0]) / speed**3,
            "acceleration": (velocity * change).sum(1) / speed,
        }
        for name, value in wanted.items():
            np.testing.assert_allclose(values[name][i, known], value, rtol=1e-4, atol=2e-4, err_msg=f"{name} of {i}")


def test_motions_meet_both_states_and_go_on_at_the_last(x64):
    fan = fan_of(line_of(circular(0.0), length=100.0), state(), grid())
    along, across = fan.along, fan.across
    for value, wanted in zip((along.station, along.speed, along.acceleration), START[0], strict=True):
        np.testing.assert_allclose(value[..., 0], wanted, rtol=1e-12)
    for value, wanted in zip((across.offset, across.first, across.second), START[1], strict=True):
        np.testing.assert_allclose(value[..., 0], wanted, rtol=1e-12)
    pairs = list(itertools.product(SPEEDS, ACCELERATIONS))
    for n, last in enumerate((10, 20)):
        np.testing.assert_allclose(along.speed[:, n, last], [v for v, _ in pairs], rtol=1e-12)
        np.testing.assert_allclose(along.acceleration[:, n, last], [a for _, a in pairs], atol=1e-12)
        np.testing.assert_allclose(across.offset[:, 0, n, last], OFFSETS, atol=1e-12)
        np.testing.assert_allclose(across.first[:, 0, n, last], 0, atol=1e-12)
        ended = slice(last + 1, None)
        steps = np.diff(np.asarray(fan.position[0, :, :, n, last:]))
        np.testing.assert_allclose(steps, np.broadcast_to(0.1 * along.speed[:, n, ended], steps.shape))
        aside = np.moveaxis(np.asarray(fan.position[1, :, :, n, ended]), 0, -1)
        np.testing.assert_allclose(aside, np.broadcast_to(OFFSETS, aside.shape), atol=1e-12)
        for still in (fan.curvature, fan.acceleration, fan.heading):
            np.testing.assert_allclose(still[:, :, n, ended], 0, atol=1e-12)


@pytest.mark.parametrize("curvature", [0.0, 0.05, -0.05])
def test_a_constant_offset_beside_a_circle_is_a_circle(curvature):
    offset, speed = 1.5, 6.0
    fan = fan_of(line_of(circular(curvature)), state((10.0, speed, 0.0), (offset, 0.0, 0.0)), grid())
    which, scale = (2, 0, 1), 1 - curvature * offset
    np.testing.assert_allclose(fan.curvature[which], curvature / scale, atol=1e-6)
    np.testing.assert_allclose(fan.speed[which], speed * scale, rtol=1e-5)
    np.testing.assert_allclose(fan.acceleration[which], 0, atol=1e-4)
    if curvature:
        x, y = np.asarray(fan.position)[(slice(None), *which)]
        np.testing.assert_allclose(np.hypot(x, y - 1 / curvature), abs(1 / curvature) * scale, rtol=1e-5)


def test_the_slope_is_the_heading_only_beside_a_straight_line():
    for curvature, equal in ((0.0, True), (0.05, False)):
        line = line_of(circular(curvature))
        exact, slope = (fan_of(line, state(), grid(heading=h)).heading for h in ("exact", "slope"))
        assert np.allclose(exact, slope, atol=1e-6) == equal


def test_mirrored_scenes_have_mirrored_candidates():
    begin = state(), state(START[0], tuple(-v for v in START[1]))
    lines = line_of(curved), line_of(functools.partial(curved, sign=-1.0))
    one, other = (plan_of(line, s) for line, s in zip(lines, begin, strict=True))
    np.testing.assert_allclose(one.terms, other.terms[:, ::-1], rtol=1e-5, atol=1e-5)
    np.testing.assert_array_equal(one.reasons, other.reasons[:, ::-1])
    mirror = np.array([1, -1, -1, 1, -1, 1])[:, None]
    np.testing.assert_allclose(one.values, mirror * np.asarray(other.values), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("lateral", ["time", "station"])
def test_standing_still_is_finite_and_so_are_its_derivatives(lateral):
    line, params = line_of(curved), scene_params(lateral=lateral, speeds=(0.0, 6.0))
    for begin in (state((10.0, 0.0, 0.0), (0.5, 0.0, 0.0)), state((10.0, 0.0, 0.0), (0.5, 0.2, 0.1))):

        def total(begin):
            found = plan_of(line, begin, params=params, mode="soft")
            return jnp.sum(found.values) + jnp.mean(found.terms), found

        slope, found = jax.grad(total, has_aux=True)(begin)
        assert all(np.all(np.isfinite(x)) for x in jax.tree.leaves((slope, found)))
    standing = fan_of(line, begin, params.grid).position[:, :, 0]
    assert np.ptp(np.asarray(standing[0]), axis=-1).max() < (0.02 if lateral == "station" else 2)


def test_the_costs_are_roots_of_integrals(x64):
    line, params = line_of(curved, spacing=0.02), scene_params()
    terms = np.asarray(plan_of(line).terms).reshape(len(FRENET_TERMS), -1)
    time = 0.1 * np.arange(26)
    speed = each(fan_of(line, state(), grid()).speed)
    weights = [getattr(params.weights, name) for name in FRENET_TERMS]
    for i, (end, s, across, d) in enumerate(motions()):
        fine = np.linspace(0, end, 3001)
        wanted = [np.sqrt(np.trapezoid(p.deriv(3)(fine) ** 2, fine)) for p in (across, s)]
        wanted.append(np.sqrt(0.1 * np.sum((speed[i] - WISH) ** 2)))
        wanted.append(np.sqrt(0.1 * np.sum(d(np.minimum(time, end))[13:] ** 2)))
        np.testing.assert_allclose(terms[:, i], np.multiply(weights, wanted), rtol=1e-5, atol=1e-9)


def limits_of(fan, params):
    """Which limits each candidate breaks, point by point; of the first four."""
    sharpest, limits = np.tan(VEHICLE.max_steering) / VEHICLE.wheelbase, params.limits
    found = []
    for heading, speed, curvature, acceleration in np.moveaxis(each(fan.values)[2:], 0, 1):
        engine = limits.max_acceleration * np.minimum(1, limits.switching_speed / np.maximum(speed, 1e-9))
        found.append(
            [
                np.any(np.abs(curvature[2:-2]) > sharpest),
                np.any(np.abs(np.diff(curvature)) / 0.1 > limits.max_curvature_rate),
                np.any((acceleration > engine) | (acceleration < -limits.max_acceleration)),
                np.any(np.abs(np.diff(heading)) / 0.1 > sharpest * speed[1:] + 1e-5),
            ]
        )
    return np.array(found).T


def test_limits_are_those_of_the_points():
    # From slow and aside to far and fast, so that each limit rejects some and not all.
    begin, line = state((10.0, 2.0, 0.0), (0.0, 1.2, 0.0)), line_of(curved)
    params = as_arrays(FrenetParams(grid=EndGrid((-2.0, 0.0, 2.0), (2.0, 8.0), (0.0,), (1.0, 2.0), n_times=26)))
    params = params.replace(limits=params.limits.replace(switching_speed=jnp.asarray(3.0)))
    reasons = np.asarray(plan_of(line, begin, params=params).reasons)
    wanted = limits_of(fan_of(line, begin, params.grid), params)
    np.testing.assert_array_equal(reasons[:4].reshape(4, -1), wanted)
    assert np.all(wanted.any(1) & ~wanted.all(1))
    stronger = params.replace(limits=params.limits.replace(switching_speed=jnp.asarray(100.0)))
    other = np.asarray(plan_of(line, begin, params=stronger).reasons)
    assert other[2].sum() < reasons[2].sum()
    assert not reasons[4:].any()


def test_reversing_and_leaving_the_line_are_reasons():
    short, back = line_of(curved, length=32.0), FRENET_LIMITS.index("reverse")
    plan = plan_of(short)
    covered = np.asarray(fan_of(short, state(), grid()).along.station).max(axis=-1)
    expected = np.broadcast_to(covered > 32, plan.cost.shape)
    np.testing.assert_array_equal(plan.reasons[FRENET_LIMITS.index("reference")], expected)
    assert expected.any()
    assert not expected.all()
    hard_brake = plan_of(line_of(curved), state((10.0, 1.0, -8.0)))
    assert np.asarray(hard_brake.reasons[back]).any()
    assert not np.asarray(plan.reasons[back]).any()


def cars(places, velocity=0.0) -> Prediction:
    """Boxes (x, y, heading) that move along x."""
    time = np.linspace(0, 4, 5)
    position = np.array([[[x + velocity * t, y] for t in time] for x, y, _ in places])
    heading = np.array([[h] * len(time) for _, _, h in places])
    size = np.ones(len(places))
    valid = jnp.arange(len(places)) < len(places) - 1
    return as_arrays(Prediction(position, heading, velocity * size, 4.5 * size, 1.8 * size, time, valid))


def touches(poses, other, velocity):
    """Whether a point of the ego's box is ever in one of the first two of the others; poses [3, T]."""
    x, y, heading = poses[:, :, None]
    share = np.linspace(-0.5, 0.5, 41)
    ahead, aside = (v.ravel() for v in np.meshgrid(share * VEHICLE.length, share * VEHICLE.width))
    ahead = ahead + float(VEHICLE.centre_offset)
    px = x + np.cos(heading) * ahead - np.sin(heading) * aside - velocity * 0.1 * np.arange(x.size)[:, None]
    py = y + np.sin(heading) * ahead + np.cos(heading) * aside
    for (bx, by), angle in zip(np.asarray(other.position[:2, 0]), np.asarray(other.heading[:2, 0]), strict=True):
        c, s = np.cos(angle), np.sin(angle)
        along, across = (px - bx) * c + (py - by) * s, (py - by) * c - (px - bx) * s
        if np.any((np.abs(along) < 2.25) & (np.abs(across) < 0.9)):
            return True
    return False


def test_collisions_are_overlaps_of_the_boxes():
    line = line_of(curved)
    other = cars([(28.0, 4.0, 0.5), (20.0, -3.0, -0.3), (15.0, 0.0, 0.0)], velocity=1.0)  # the last one does not count
    fan, plan = fan_of(line, state(), grid()), plan_of(line, prediction=other)
    gap = np.asarray(limits.clearance(fan, other, VEHICLE, grid())).ravel()
    hits = np.asarray(plan.reasons[FRENET_LIMITS.index("collision")]).ravel()
    np.testing.assert_array_equal(hits, gap < 0)
    for i, poses in enumerate(np.moveaxis(each(fan.values)[:3], 0, 1)):
        if abs(gap[i]) > 0.1:  # the points within a box are that far apart
            assert touches(poses, other, velocity=1.0) == hits[i]
    assert hits.any()
    assert not hits.all()


def test_the_choice_is_the_cheapest_that_breaks_no_limit():
    line = line_of(curved)
    plan = plan_of(line, prediction=cars([(28.0, 4.0, 0.5), (0.0, 0.0, 0.0)]))
    feasible = ~np.asarray(plan.reasons).any(axis=0).ravel()
    total = np.asarray(plan.terms).sum(axis=0).ravel()
    assert feasible.any()
    assert not feasible.all()
    assert plan.chosen == np.where(feasible, total, np.inf).argmin()
    assert plan.feasible
    np.testing.assert_allclose(np.asarray(plan.cost).ravel()[feasible], total[feasible], rtol=1e-6)
    np.testing.assert_array_equal(plan.values, each(fan_of(line, state(), grid()).values)[:, int(plan.chosen)])


def test_where_all_break_a_limit_the_least_bad_is_taken():
    line = line_of(curved, length=11.0)
    plan = plan_of(line)
    assert not plan.feasible
    assert plan.reasons[FRENET_LIMITS.index("reference")].all()
    broken = np.asarray(plan.reasons).sum(axis=0).ravel()
    assert broken[int(plan.chosen)] == broken.min()
    assert np.all(np.isfinite(plan.values))


def test_soft_becomes_hard_as_the_temperature_falls():
    line, hard = line_of(curved), plan_of(line_of(curved))
    far, near = (np.abs(plan_of(line, mode="soft", temperature=t).values - hard.values).max() for t in (1.0, 1e-3))
    assert near < 1e-4
    assert far > 1e-2
    through = plan_of(line, mode="straight_through", temperature=1.0)
    np.testing.assert_allclose(through.values, hard.values, rtol=1e-5, atol=1e-5)


def test_the_soft_plan_has_the_derivative_of_its_value(x64):
    line, begin = line_of(curved), state((10.23, 9.0, 0.4))  # no point on a row of the table, where it has a kink
    relaxation, rest = as_arrays(Relaxation(1.0, mode="soft")), (None, as_arrays(VEHICLE), scene_params())
    mix = jnp.asarray(np.random.default_rng(0).normal(size=(6, 26)))

    @jax.jit
    def total(begin):
        found = choice.plan(line, begin, jnp.asarray(WISH), *rest, relaxation)
        return jnp.sum(mix * found.values)

    slope = jax.jit(jax.grad(total))(begin)
    for name in ("station", "offset"):
        for i in range(3):
            step = jnp.zeros(3).at[i].set(1e-6)
            a, b = (total(begin.replace(**{name: getattr(begin, name) + sign * step})) for sign in (1, -1))
            np.testing.assert_allclose(getattr(slope, name)[i], (a - b) / 2e-6, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("at_once", [1, 2])
def test_many_scenarios_are_planned_like_each(at_once):
    lines = [line_of(curved), line_of(circular(0.0)), line_of(circular(0.01))]
    begins = [state(), state(offset=(1.0, 0.0, 0.0)), state((10.0, 7.0, 0.0))]
    stacked = [jax.tree.map(lambda *x: jnp.stack(x), *v) for v in (lines, begins)]
    wishes = jnp.array([WISH, 8.0, 12.0])
    rest = (None, as_arrays(VEHICLE), scene_params(), as_arrays(Relaxation()))
    many = jax.jit(choice.plans, static_argnames="at_once")(*stacked, wishes, *rest, at_once=at_once)
    for i in range(3):
        one = plan_of(lines[i], begins[i], wish=wishes[i])
        for found, wanted in zip(jax.tree.leaves(many), jax.tree.leaves(one), strict=True):
            np.testing.assert_allclose(found[i], wanted, rtol=1e-5, atol=1e-5)


def test_the_line_of_a_route_is_the_road(scenes):
    window = scenes.road(curvature=0.02, origin=(3.0, -2.0), heading=0.4)
    station = np.array([0.0, 7.3, 100.9])
    foot = look_up(along_route(window), jnp.asarray(station))
    for i, s in enumerate(station):
        position, heading = scenes.place(window, s, 0.0)
        np.testing.assert_allclose([foot.x[i], foot.y[i]], position, atol=1e-4)
        np.testing.assert_allclose(foot.heading[i], heading, atol=1e-5)
    assert not np.any(foot.outside)
    ends = look_up(along_route(window), jnp.asarray([-2.0, 223.0]))
    np.testing.assert_array_equal(ends.outside, True)
    ahead = np.array([ends.x[1], ends.y[1]]) - np.asarray(window.position[-1])
    np.testing.assert_allclose(np.hypot(*ahead), 3.0, rtol=1e-4)
