"""Eq. 1-5: registration finds the pose and equals the equations in float64; its gradient is the fixed point's."""

import jax
import jax.numpy as jnp
import jaxlie
import numpy as np
import pytest

from tests.registration.conftest import MAP, courtyard, covered
from urbanjax import registration
from urbanjax.registration import AlignParams, CovarianceParams
from urbanjax.registration.linear import FactorParams
from urbanjax.types import Status, as_arrays

START = jaxlie.SE3.identity


def error_of(found: jaxlie.SE3, truth: jaxlie.SE3) -> tuple[float, float]:
    """Metres and radians."""
    off = found.inverse() @ truth
    return float(jnp.linalg.norm(off.translation())), float(jnp.linalg.norm(off.rotation().log()))


def in_double(tree):
    return as_arrays(tree, jnp.float64)


@pytest.mark.parametrize("method", ["vgicp", "ndt"])
@pytest.mark.parametrize("neighbours", [1, 7, 27])
def test_finds_the_pose(method, neighbours, pair, truth, align_jit, build_jit):
    source, target = pair
    world = build_jit(target, as_arrays(MAP.replace(method=method)))
    params = AlignParams(neighbours=neighbours, factor=FactorParams(max_distance=3.0))
    found = align_jit(source, world, start=START(), params=as_arrays(params))
    metres, radians = error_of(found.pose, truth)
    assert Status(int(found.status)) is Status.OK
    assert float(found.inlier_share) > (0.9 if method == "vgicp" else 0.4)
    assert metres < (0.03 if method == "vgicp" else 0.05)
    assert radians < (0.004 if method == "vgicp" else 0.012)


def oracle(source, world, pose: np.ndarray, params: FactorParams):
    """Hessian, gradient and cost by the equations, point by point, in float64 numpy."""
    rows, table = np.asarray(world.rows, float), np.asarray(world.table)
    origin, size, shape = np.asarray(world.origin, float), float(world.resolution), world.shape
    full = lambda s: np.array([[s[0], s[1], s[2]], [s[1], s[3], s[4]], [s[2], s[4], s[5]]])  # noqa: E731
    hessian, gradient, cost = np.zeros((6, 6)), np.zeros(6), 0.0
    for s, c, valid in zip(np.asarray(source.position).T, np.asarray(source.covariance).T, source.valid, strict=True):
        moved = pose[:3, :3] @ s + pose[:3, 3] - origin
        cell = np.floor(moved / size).astype(int)
        if not valid or np.any(cell < 0) or np.any(cell >= shape):
            continue
        row = rows[table[(cell[0] * shape[1] + cell[1]) * shape[2] + cell[2]]]
        e = row[:3] - moved
        if row[9] == 0 or e @ e > params.max_distance**2:
            continue
        omega = np.linalg.inv(full(row[3:9]) + pose[:3, :3] @ full(c) @ pose[:3, :3].T)
        skew = np.array([[0, -s[2], s[1]], [s[2], 0, -s[0]], [-s[1], s[0], 0]])
        jacobian = np.hstack([pose[:3, :3] @ skew, -pose[:3, :3]])
        weight = {"one": 1.0, "sqrt_count": np.sqrt(row[9]), "count": row[9]}[params.weight]
        distance = e @ omega @ e
        if params.kernel == "cauchy":
            weight *= 1 / (1 + distance / params.kernel_scale**2)
        if params.kernel == "huber":
            weight *= min(1.0, params.kernel_scale / np.sqrt(distance))
        hessian += weight * jacobian.T @ omega @ jacobian
        gradient += weight * jacobian.T @ omega @ e
        cost += weight * distance / 2
    return hessian, gradient, cost


@pytest.mark.parametrize(
    ("weight", "kernel"), [("one", "none"), ("sqrt_count", "huber"), ("count", "cauchy"), ("one", "cauchy")]
)
def test_system_equals_the_equations(weight, kernel, pair, x64):
    source, target = in_double(pair[0]), in_double(pair[1])
    world = jax.jit(registration.build)(target, as_arrays(MAP))
    factor = FactorParams(weight=weight, kernel=kernel, kernel_scale=1.5)
    start = jaxlie.SE3.exp(jnp.array([0.3, -0.2, 0.05, 0.01, -0.01, 0.04]))
    found = jax.jit(registration.align)(
        source, world, start=start, params=as_arrays(AlignParams(factor=factor, max_iterations=1))
    )
    assert Status(int(found.status)) is Status.NOT_CONVERGED
    hessian, gradient, cost = oracle(source, world, np.asarray(start.as_matrix()), factor)
    np.testing.assert_allclose(found.hessian, hessian, rtol=0, atol=1e-10 * np.abs(hessian).max())
    np.testing.assert_allclose(found.gradient, gradient, rtol=0, atol=1e-10 * np.abs(gradient).max())
    assert float(found.cost) == pytest.approx(cost, rel=1e-10)


def test_gradient_is_that_of_the_fixed_point(pair, x64):
    source, target = in_double(pair[0]), in_double(pair[1])
    params = as_arrays(AlignParams(rotation_tolerance=1e-12, translation_tolerance=1e-12, max_iterations=60))
    world = jax.jit(registration.build)(target, as_arrays(MAP))
    rng = np.random.default_rng(0)

    def pose(amount, points, shapes, rows):
        cloud = source.replace(
            position=source.position + amount * points, covariance=source.covariance + amount * shapes
        )
        moved = world.replace(rows=world.rows + amount * rows)
        return registration.align(cloud, moved, start=START(), params=params).pose.wxyz_xyz

    points, shapes, rows = (rng.normal(size=x.shape) for x in (source.position, source.covariance, world.rows))
    rows[:, 9] = 0
    means, spreads = rows.copy(), 0.1 * rows
    means[:, 3:], spreads[:, :3] = 0, 0
    forward = jax.jit(lambda at, *x: jax.jvp(lambda amount: pose(amount, *x), (at,), (1.0,)))
    backward = jax.jit(jax.grad(lambda *x: pose(*x)[4]))
    for which in range(4):
        towards = [
            jnp.asarray(x if i == which else 0 * x) for i, x in enumerate((points, 0.1 * shapes, means, spreads))
        ]
        direction = towards[0], towards[1], towards[2] + towards[3]
        (_, slope), (ahead, _), (behind, _) = (forward(at, *direction) for at in (0.0, 1e-6, -1e-6))
        difference = (ahead - behind) / 2e-6  # no correspondence changes in between
        assert np.abs(slope).max() > 1e-3
        np.testing.assert_allclose(slope, difference, rtol=1e-3, atol=1e-6)
        np.testing.assert_allclose(backward(0.0, *direction), slope[4], rtol=1e-9)


def test_a_batch_of_starts_equals_the_runs_one_by_one(pair, x64):
    source, target = in_double(pair[0]), in_double(pair[1])
    world = jax.jit(registration.build)(target, as_arrays(MAP))
    params = as_arrays(AlignParams())
    twists = 0.1 * np.random.default_rng(1).normal(size=(64, 6))
    starts = jax.vmap(jaxlie.SE3.exp)(jnp.asarray(twists))
    one = jax.jit(lambda start: registration.align(source, world, start=start, params=params))
    together = jax.jit(jax.vmap(lambda start: registration.align(source, world, start=start, params=params)))(starts)
    in_turn = jax.jit(lambda starts: registration.align_starts(source, world, starts=starts, params=params, at_once=4))(
        starts
    )
    for i in range(len(twists)):
        alone = one(jax.tree.map(lambda x, i=i: x[i], starts))
        for many in (together, in_turn):
            np.testing.assert_allclose(many.pose.wxyz_xyz[i], alone.pose.wxyz_xyz, rtol=0, atol=1e-9)
            assert int(many.iterations[i]) == int(alone.iterations)


def test_kilometres_from_the_origin_the_answer_is_the_same_within_a_millimetre(pair, align_jit, build_jit):
    source, target = pair
    far = np.array([4000.0, -3000.0, 30.0], np.float32)
    params, maps = as_arrays((AlignParams(), MAP))
    near = align_jit(source, build_jit(target, maps), start=START(), params=params).pose
    moved = target.replace(position=target.position + far[:, None])
    start = jaxlie.SE3.from_translation(jnp.asarray(far))
    away = align_jit(source, build_jit(moved, maps), start=start, params=params).pose
    np.testing.assert_allclose(away.translation() - far, near.translation(), atol=1e-3)
    np.testing.assert_allclose(away.rotation().as_matrix(), near.rotation().as_matrix(), atol=1e-4)


def test_nothing_in_common_is_a_value(pair, align_jit, build_jit):
    source, target = pair
    world = build_jit(target, as_arrays(MAP))
    lost = align_jit(
        source,
        world,
        start=jaxlie.SE3.from_translation(jnp.array([500.0, 0.0, 0.0])),
        params=as_arrays(AlignParams()),
    )
    assert float(lost.inliers) == 0
    assert Status(int(lost.status)) is Status.NO_PAIRS
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(lost) if leaf.dtype != bool)
    empty = align_jit(
        source.replace(valid=jnp.zeros_like(source.valid)), world, start=START(), params=as_arrays(AlignParams())
    )
    assert float(empty.inlier_share) == 0
    assert not empty.converged
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(empty) if leaf.dtype != bool)


def test_uncalibrated_covariance_predicts_the_scatter_of_the_answers_on_one_map(align_jit, build_jit):
    sandwich = CovarianceParams(scale=1.0, share=0.0, floor_rotation=0.0, floor_translation=0.0)
    params, maps = as_arrays((AlignParams(covariance=sandwich), MAP))
    world = build_jit(covered(courtyard(1000, 100)), maps)
    twists, sizes = [], []
    for seed in range(20):
        found = align_jit(covered(courtyard(1000, seed)), world, start=START(), params=params)
        twists.append(np.asarray(found.pose.log()))
        sizes.append(np.sqrt(np.diagonal(np.asarray(found.covariance))))
    scatter = np.std(twists, axis=0)[[3, 4, 5, 0, 1, 2]]
    ratio = scatter / np.mean(sizes, axis=0)
    assert np.all((ratio > 0.3) & (ratio < 3.0)), ratio
