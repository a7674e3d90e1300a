"""Curves between nodes against integrals and differences in the plane."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad

from urbanjax.numerics.soft import Relaxation
from urbanjax.planning.basis import smooth
from urbanjax.planning.lattice.edges import CORNER, QUINTIC, EdgeLimits, Steps, join, quintic_basis, refused, sharpest
from urbanjax.vehicle.params import VehicleParams

LENGTH = 10.0


def steps(curvature=0.0, half_width=5.0, spacing=LENGTH, profile=QUINTIC):
    """One step along an arc, or with curvature (start, end) along a clothoid; the road as wide at all shares."""
    shares = profile.shares
    ends = np.broadcast_to(curvature, 2)
    half = np.broadcast_to(half_width, shares.shape)
    kappa = ends[0] + (ends[1] - ends[0]) * shares
    return Steps(*(jnp.asarray(x) for x in ([spacing], kappa[None], -half[None], half[None])))


def between(a, b, slopes=(0.0, 0.0), profile=QUINTIC, **road):
    """The edge from offset a to offset b (m)."""
    offset = tuple(jnp.asarray([[x]], float) for x in (a, b))
    slope = tuple(jnp.asarray([[x]], float) for x in slopes)
    found = join(offset, slope, steps=steps(profile=profile, **road), profile=profile, vehicle=VehicleParams())
    return jax.tree.map(lambda x: float(x[0, 0, 0]), found)


def in_the_plane(a, b, curvature, slopes=(0.0, 0.0), n=4001):
    """Length and greatest curvature of the quintic edge beside a circular arc, from points in the plane."""
    u = np.linspace(0, 1, n)
    d = quintic_basis(u)[0] @ np.array([a, b, LENGTH * slopes[0], LENGTH * slopes[1]])
    h = curvature * LENGTH * u
    line = np.stack([np.sin(h), 1 - np.cos(h)], -1) / curvature if curvature else np.stack([LENGTH * u, 0 * u], -1)
    points = line + d[:, None] * np.stack([-np.sin(h), np.cos(h)], -1)
    first, second = np.gradient(points, u, axis=0), np.gradient(np.gradient(points, u, axis=0), u, axis=0)
    speed = np.linalg.norm(first, axis=-1)
    bend = (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / speed**3
    inner = slice(4, -4)
    return np.linalg.norm(np.diff(points, axis=0), axis=-1).sum(), np.abs(bend[inner]).max(), speed[inner], bend[inner]


@pytest.mark.parametrize("profile", [QUINTIC, CORNER])
def test_beside_an_arc_an_edge_is_as_long_as_its_own_circle(x64, profile):
    for offset in (-4.0, 0.0, 4.0):
        edge = between(offset, offset, profile=profile, curvature=0.05)
        assert LENGTH + edge.detour == pytest.approx(0.05 * LENGTH * (1 / 0.05 - offset), abs=1e-12)
        assert edge.curvature == pytest.approx(1 / (1 / 0.05 - offset), rel=1e-12)


def test_an_s_bend_on_a_straight_has_the_curvature_of_its_quintic(x64):
    edge = between(-0.3, 0.3)
    greatest = 10 / np.sqrt(3) * 0.6 / LENGTH**2
    slope = 30 * 0.6 / LENGTH * (0.25 - 1 / 12) ** 2  # at that place
    assert edge.curvature == pytest.approx(greatest / (1 + slope**2) ** 1.5, rel=1e-9)


@pytest.mark.parametrize(
    ("a", "b", "curvature", "slopes"),
    [
        (0.0, 2.0, 0.0, (0, 0)),
        (1.0, -1.5, 0.03, (0, 0)),
        (-2.0, 0.5, -0.06, (0.1, -0.05)),
        (3.0, 3.5, 0.08, (0.0, 0.1)),
    ],
)
def test_length_curvature_and_bending_are_those_in_the_plane(x64, a, b, curvature, slopes):
    edge = between(a, b, slopes, curvature=curvature)
    length, greatest, speed, bend = in_the_plane(a, b, curvature, slopes)
    assert LENGTH + edge.detour == pytest.approx(length, rel=1e-5)
    assert edge.curvature == pytest.approx(greatest, rel=0.02)
    assert edge.bending == pytest.approx(np.mean(speed * bend**2), rel=0.01)


def test_a_step_straight_in_the_frenet_frame_is_as_long_as_its_chord(x64):
    assert LENGTH + between(0.0, 3.0, profile=CORNER).detour == pytest.approx(np.hypot(LENGTH, 3.0), rel=1e-12)
    exact = quad(lambda u: np.hypot(LENGTH * (1 - 0.04 * (1 + u)), 1.0), 0, 1)[0]
    assert LENGTH + between(1.0, 2.0, profile=CORNER, curvature=0.04).detour == pytest.approx(exact, rel=1e-6)


def test_corners_are_as_sharp_as_the_spline_that_reads_them_off(x64):
    nodes = jnp.array([0.0, 0.0, 0.0, 0.9, 0.9, 0.9, 0.9])
    _, _, second = smooth(jnp.linspace(0, 6 * LENGTH, 601), 0.0, LENGTH, nodes)
    step = between(0.0, 0.9, profile=CORNER)
    assert step.curvature == pytest.approx(float(jnp.abs(second).max()), rel=0.02)


def test_an_edge_exists_up_to_the_curvature_limit(x64):
    limits = EdgeLimits(max_curvature=0.1)
    widest = 0.1 * LENGTH**2 * np.sqrt(3) / 10  # but for the slope, which lowers the curvature by some per cent
    for share, gone in ((0.95, 0), (1.3, 1)):
        offset = (jnp.zeros((1, 1)), jnp.full((1, 1), share * widest))
        found = join(
            offset, jax.tree.map(jnp.zeros_like, offset), steps=steps(), profile=QUINTIC, vehicle=VehicleParams()
        )
        limit = sharpest(VehicleParams(), limits)
        assert refused(found, limit, limits=limits, relaxation=Relaxation())[0, 0, 0] == gone
        cold = refused(found, limit, limits=limits, relaxation=Relaxation(1e-3, mode="soft"))
        assert float(cold[0, 0, 0]) == pytest.approx(gone, abs=1e-6)


def test_the_limit_is_the_steerings_unless_a_smaller_one_is_asked_for(x64):
    vehicle = VehicleParams(max_steering=0.5, wheelbase=2.5)
    assert float(sharpest(vehicle, EdgeLimits())) == pytest.approx(np.tan(0.5) / 2.5)
    assert float(sharpest(vehicle, EdgeLimits(steering_share=0.5))) == pytest.approx(0.5 * np.tan(0.5) / 2.5)
    assert float(sharpest(vehicle, EdgeLimits(max_curvature=0.05))) == pytest.approx(0.05)


@pytest.mark.parametrize("profile", [QUINTIC, CORNER])
def test_an_edge_leaves_the_road_where_that_narrows_between_its_nodes(x64, profile):
    half = 3.0 - 1.5 * np.sin(np.pi * profile.shares)
    edge = between(1.5, 1.5, profile=profile, half_width=half)
    assert edge.outside == pytest.approx(1.5 + VehicleParams().width / 2 - 1.5)
    ends = between(1.5, 1.5, profile=profile, half_width=3.0)
    assert ends.outside == pytest.approx(1.5 + VehicleParams().width / 2 - 3.0)


def test_single_precision_is_enough_and_gradients_are_finite():
    def total(offset, kappa):
        road = steps(curvature=0.0).replace(curvature=jnp.full((1, QUINTIC.shares.size), kappa))
        found = join((offset, offset), (0 * offset, 0 * offset), steps=road, profile=QUINTIC, vehicle=VehicleParams())
        return jnp.sum(found.detour) + jnp.sum(found.curvature) + jnp.sum(found.bending) + jnp.sum(found.outside)

    offset = jnp.linspace(-2.0, 2.0, 5)[None]
    single = jax.jit(jax.value_and_grad(total, argnums=(0, 1)))(offset, jnp.asarray(0.04))
    assert all(np.all(np.isfinite(x)) for x in jax.tree.leaves(single))
    with jax.enable_x64(True):
        double = jax.jit(total)(jnp.linspace(-2.0, 2.0, 5)[None], jnp.asarray(0.04))
    assert float(single[0]) == pytest.approx(float(double), rel=1e-5)
    assert np.all(np.isfinite(jax.jit(jax.grad(total))(jnp.zeros((1, 3)), jnp.asarray(0.0))))
