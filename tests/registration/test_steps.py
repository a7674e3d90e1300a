"""What a step of the body does to points and to the cost, and what a share of the points is good for."""

import jax
import jax.numpy as jnp
import jaxlie
import numpy as np
import pytest

from tests.registration.conftest import MAP, courtyard
from urbanjax import registration
from urbanjax.registration import AlignParams
from urbanjax.registration.correspond import correspond
from urbanjax.registration.downsample import DownsampleParams
from urbanjax.registration.linear import FactorParams, Rigid, change, displacement, linearise
from urbanjax.registration.points import thinned
from urbanjax.registration.preprocess import PreprocessParams
from urbanjax.types import as_arrays


@pytest.mark.parametrize("size", [0.0, 1e-4, 0.031, 0.033, 1.0, 3.0])
def test_a_displacement_is_the_exponential_less_the_identity(size, x64):
    twist = size * np.array([0.6, -0.64, 0.48, 1.0, -2.0, 3.0])
    moved = jaxlie.SE3.exp(jnp.asarray(np.roll(twist, 3))).as_matrix()
    expected = np.asarray(moved)[:3] - np.eye(4)[:3]
    np.testing.assert_allclose(displacement(jnp.asarray(twist)), np.roll(expected, 1, axis=1), rtol=0, atol=1e-13)


@pytest.mark.parametrize("kernel", ["none", "cauchy"])
def test_the_sums_say_what_a_step_does_to_the_cost(pair, kernel, x64):
    source, target = (jax.tree.map(lambda x: x if x.dtype == bool else jnp.asarray(x, float), c) for c in pair)
    world = jax.jit(registration.build)(target, as_arrays(MAP))
    factor = as_arrays(FactorParams(kernel=kernel))
    pose = Rigid(jnp.eye(3), jnp.array([0.3, -0.2, 0.05]) - world.origin)
    slot = correspond(world, pose.move(source.position), valid=source.valid, neighbours=1)
    at = linearise(pose, source, slot=slot, target=world, params=factor)
    twist = jnp.array([0.02, -0.01, 0.03, 0.1, -0.2, 0.05])
    rows, after = world.rows[slot], pose.step(twist)
    mean, held = rows[:, :3].T, rows[:, [3, 4, 5, 4, 6, 7, 5, 7, 8]].reshape(-1, 3, 3)
    shape = source.covariance.T[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)
    before, later = (pose.back(mean - p.move(source.position)).T for p in (pose, after))
    omega = np.linalg.inv(np.asarray(held + shape))
    first, second = (np.einsum("ni,nij,nj->n", e, omega, e) for e in (before, later))
    weight = np.asarray(at.near) / (1 + first / 9 if kernel == "cauchy" else 1)
    assert at.near.sum() > 500
    expected = weight @ (second - first) / 2
    np.testing.assert_allclose(change(at, displacement(twist)), expected, rtol=1e-9)


@pytest.fixture(scope="module")
def dense(truth):
    """Two scans of the courtyard with points enough for a share of them to be looked at first, and the map."""
    back = np.asarray(truth.inverse().as_matrix(), float)
    seen = courtyard(40_000, 1) @ back[:3, :3].T + back[:3, 3]
    down = as_arrays(PreprocessParams(downsample=DownsampleParams(resolution=0.2, capacity=16384)))
    prepare = jax.jit(registration.preprocess)
    clouds = [prepare(*registration.padded(x, 40_000), params=down)[0] for x in (seen, courtyard(40_000, 2))]
    assert all(int(cloud.valid.sum()) > 8000 for cloud in clouds)
    return clouds[0], jax.jit(registration.build)(clouds[1], as_arrays(MAP))


def test_a_share_of_the_points_first_spares_iterations_and_leaves_the_answer(dense, truth, align_jit):
    found = {}
    for coarse in (1, 8):
        params = as_arrays(AlignParams(coarse=coarse))
        found[coarse] = align_jit(*dense, start=jaxlie.SE3.identity(), params=params)
        assert found[coarse].converged
        error = (found[coarse].pose.inverse() @ truth).translation()
        assert float(jnp.linalg.norm(error)) < 7e-3
    apart = (found[8].pose.inverse() @ found[1].pose).translation()
    assert float(jnp.linalg.norm(apart)) < 2e-3
    assert int(found[8].iterations) < int(found[1].iterations)


def test_a_single_iteration_is_one_at_the_start_with_all_points(dense, align_jit):
    once = [
        align_jit(*dense, start=jaxlie.SE3.identity(), params=as_arrays(AlignParams(max_iterations=1, coarse=coarse)))
        for coarse in (1, 8)
    ]
    np.testing.assert_array_equal(once[0].pose.wxyz_xyz, once[1].pose.wxyz_xyz)


def test_a_thinned_cloud_has_every_part_of_it_whatever_repeats_in_its_order():
    index = jnp.arange(1003)
    cloud = registration.cloud(jnp.stack([index] * 3, 1).astype(float), valid=index < 900)
    few = thinned(cloud, 8)
    which = np.asarray(few.position[0]).astype(int)
    assert len(which) == 126
    assert (np.diff(which) > 0).all()
    assert np.diff(which).max() < 16
    np.testing.assert_array_equal(few.valid, which < 900)
    assert (np.bincount(which % 16, minlength=16) > 2).all()
