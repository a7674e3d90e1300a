"""Station and offset on reference lines, and profiles of the offset."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.traffic.course import line

place = jax.jit(line.place, static_argnames=("closed", "block"))
profile = jax.jit(line.profile, static_argnames="bins")
ANGLE = np.linspace(0, 2 * np.pi, 400, endpoint=False)
CIRCLE = (50 * np.stack([np.cos(ANGLE), np.sin(ANGLE)], -1)).astype(np.float32)
ALL = np.ones(400, bool)


def around(angle, radius):
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], -1).astype(np.float32)


def test_stations_and_offsets_on_a_circle():
    angle = np.array([0.001, 1.0, 3.0, 6.2, -0.001])
    radius = np.array([48.0, 51, 50, 47, 53])
    found = place(around(angle, radius), np.ones(5, bool), line=CIRCLE, line_mask=ALL, closed=True, block=2)
    assert found.length == pytest.approx(2 * np.pi * 50, rel=1e-4)
    np.testing.assert_allclose(found.station, 50 * (angle % (2 * np.pi)), atol=0.02)
    np.testing.assert_allclose(found.offset, 50 - radius, atol=0.01)
    np.testing.assert_allclose(found.distance, np.abs(50 - radius), atol=0.01)


def test_moving_the_line_with_the_samples_changes_nothing():
    points = around(np.linspace(0.3, 6.1, 5), 48.0)
    c, s = np.cos(2.0), np.sin(2.0)
    turn = np.float32([[c, s], [-s, c]])
    found = place(points, np.ones(5, bool), line=CIRCLE, line_mask=ALL, closed=True)
    moved = place(points @ turn + 300, np.ones(5, bool), line=CIRCLE @ turn + 300, line_mask=ALL, closed=True)
    np.testing.assert_allclose(moved.station, found.station, atol=2e-3)
    np.testing.assert_allclose(moved.offset, found.offset, atol=1e-3)


def test_the_offset_beside_a_closed_seam_is_that_from_its_vertex():
    square = np.float32([[0, 0], [10, 0], [10, 10], [0, 10]])
    found = place(
        np.float32([[-3, -4], [13, -4]]), np.ones(2, bool), line=square, line_mask=np.ones(4, bool), closed=True
    )
    np.testing.assert_allclose(found.offset, -5, rtol=1e-6)
    np.testing.assert_allclose(found.station, [0, 10], atol=1e-5)


def test_padding_and_samples_that_do_not_count():
    points = around(np.array([1.0, 2.0]), 49.0)
    padded = np.concatenate([CIRCLE, np.full((3, 2), np.nan, np.float32)])
    found = place(points, np.ones(2, bool), line=CIRCLE, line_mask=ALL, closed=True)
    again = place(points, np.ones(2, bool), line=padded, line_mask=np.arange(403) < 400, closed=True)
    np.testing.assert_allclose(again.station, found.station, rtol=1e-6)
    missing = place(np.full((2, 2), np.nan, np.float32), np.zeros(2, bool), line=CIRCLE, line_mask=ALL, closed=True)
    np.testing.assert_array_equal(missing.offset, 0)


def test_an_offset_driver_is_apart_by_the_offset_at_any_spacing():
    profiles = []
    for n, radius in ((500, 50.0), (170, 48.5)):
        found = place(
            around(np.linspace(0, 2 * np.pi, n), radius), np.ones(n, bool), line=CIRCLE, line_mask=ALL, closed=True
        )
        profiles.append(profile(found.station, found.offset, mask=np.ones(n, bool), length=found.length, bins=20))
    mean, root, some = line.apart(*profiles)
    assert some
    assert mean == pytest.approx(1.5, abs=0.01)
    assert root == pytest.approx(1.5, abs=0.01)
    assert int(profiles[0].count.sum()) == 500
    assert float(profiles[0].std.max()) < 0.01


def test_a_profile_is_the_mean_of_each_bin_and_empty_bins_do_not_count():
    station, offset = np.float32([1, 2, 11, 25]), np.float32([1, 3, -1, 7])
    found = profile(station, offset, mask=np.array([1, 1, 1, 0], bool), length=30.0, bins=3)
    np.testing.assert_array_equal(found.count, [2, 1, 0])
    np.testing.assert_allclose(found.mean, [2, -1, 0])
    np.testing.assert_allclose(found.std, [1, 0, 0])
    np.testing.assert_allclose(found.station, [5, 15, 25])
    nothing = profile(station, offset, mask=np.zeros(4, bool), length=30.0, bins=3)
    assert not line.apart(found, nothing)[2]


def test_gradient_of_the_profile_is_that_of_the_offset(x64):
    points = around(np.array([1.0, 1.1, 3.0]), 49.0).astype(float)

    @jax.jit
    def total(points):
        found = line.place(
            points, jnp.ones(3, bool), line=jnp.asarray(CIRCLE, float), line_mask=jnp.asarray(ALL), closed=True
        )
        profile = line.profile(found.station, found.offset, mask=jnp.ones(3, bool), length=found.length, bins=4)
        return jnp.sum(profile.mean**2) + jnp.sum(profile.std) + jnp.sum(found.station)

    slope = jax.grad(total)(points)
    for at in np.ndindex(points.shape):
        step = np.zeros_like(points)
        step[at] = 1e-6
        assert slope[at] == pytest.approx(float(total(points + step) - total(points - step)) / 2e-6, abs=1e-5)
