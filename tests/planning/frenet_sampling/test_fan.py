"""Motions over a grid of Frenet end states and their relations in the plane."""

import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.planning.frenet_sampling.helpers import (
    ACCELERATIONS,
    OFFSETS,
    SPEEDS,
    START,
    circular,
    curved,
    each,
    fan_of,
    grid,
    line_of,
    motions,
    place,
    plan_of,
    scene_params,
    state,
)
from urbanjax.planning.frenet_sampling.fan import FIELDS


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
