"""NDT and point-to-nearest-point GICP equal plain float64 NumPy, written from the equations, map and all."""

import jax
import jax.numpy as jnp
import jaxlie
import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from tests.registration.conftest import MAP
from urbanjax import registration
from urbanjax.registration import AlignParams
from urbanjax.registration.linear import FactorParams
from urbanjax.types import as_arrays

SIZE, OUTLIERS, REACH = 2.0, 0.55, 1.5
C1, C2 = 10 * (1 - OUTLIERS), OUTLIERS / SIZE**3
D1 = -np.log(C1 + C2) + np.log(C2)
D2 = -2 * np.log((-np.log(C1 * np.exp(-0.5) + C2) + np.log(C2)) / D1)
FACTOR = FactorParams(max_distance=REACH, outlier_share=OUTLIERS)


def step(pose: np.ndarray, twist: np.ndarray) -> np.ndarray:
    """T exp(twist), twist [omega; v]."""
    log = np.zeros((4, 4))
    log[:3, :3], log[:3, 3] = np.cross(np.eye(3), twist[:3]), twist[3:]
    out, term = np.eye(4), np.eye(4)
    for k in range(1, 20):
        term = term @ log / k
        out = out + term
    return pose @ out


def system(points, pose, means, informations, weights) -> tuple[np.ndarray, np.ndarray, float]:
    """Hessian, gradient and cost of sum w e' Omega e / 2 with e = mean - T s, in the map's frame."""
    hessian, gradient, cost = np.zeros((6, 6)), np.zeros(6), 0.0
    turn = pose[:3, :3]
    for s, mean, omega, weight in zip(points, means, informations, weights, strict=True):
        e = mean - turn @ s - pose[:3, 3]
        jacobian = np.hstack([turn @ np.cross(np.eye(3), s), -turn])
        hessian += weight * jacobian.T @ omega @ jacobian
        gradient += weight * jacobian.T @ omega @ e
        cost += weight * e @ omega @ e / 2
    return hessian, gradient, cost


def fixed_point(problem, pose: np.ndarray) -> np.ndarray:
    """Gauss-Newton until nothing moves."""
    for _ in range(100):
        hessian, gradient, _ = problem(pose)
        twist = -np.linalg.solve(hessian, gradient)
        pose = step(pose, twist)
        if np.abs(twist).max() < 1e-13:
            return pose
    raise AssertionError("the oracle did not converge")


class Ndt:
    """Mean and raised unbiased covariance of every voxel with six points or more."""

    def __init__(self, points: np.ndarray):
        self.voxels = {}
        for cell in np.unique(np.floor(points / SIZE).astype(int), axis=0):
            inside = points[np.all(np.floor(points / SIZE).astype(int) == cell, axis=1)]
            if len(inside) >= 6:
                values, vectors = np.linalg.eigh(np.cov(inside.T))
                raised = vectors @ np.diag(np.maximum(values, 0.01 * values[-1])) @ vectors.T
                self.voxels[tuple(cell)] = inside.mean(0), np.linalg.inv(raised)

    def pairs(self, points: np.ndarray, pose: np.ndarray):
        moved = points @ pose[:3, :3].T + pose[:3, 3]
        found = [self.voxels.get(tuple(cell)) for cell in np.floor(moved / SIZE).astype(int)]
        kept = [i for i, v in enumerate(found) if v is not None and np.linalg.norm(v[0] - moved[i]) <= REACH]
        return points[kept], [found[i][0] for i in kept], [found[i][1] for i in kept]

    def score(self, points, pose, means, omegas) -> np.ndarray:
        e = np.array(means) - points @ pose[:3, :3].T - pose[:3, 3]
        return D1 * np.exp(-D2 * np.einsum("ni,nij,nj->n", e, np.array(omegas), e) / 2)

    def __call__(self, points: np.ndarray, pose: np.ndarray):
        held, means, omegas = self.pairs(points, pose)
        return system(held, pose, means, omegas, -D2 * self.score(held, pose, means, omegas))


@pytest.fixture
def clouds(pair, x64):
    return as_arrays(pair[0], jnp.float64), as_arrays(pair[1], jnp.float64)


@pytest.fixture
def start() -> jaxlie.SE3:
    return jaxlie.SE3.exp(jnp.array([0.3, -0.2, 0.05, 0.01, -0.01, 0.04]))


def tight(**changes) -> AlignParams:
    return as_arrays(
        AlignParams(factor=FACTOR, rotation_tolerance=1e-12, translation_tolerance=1e-12, max_iterations=60, **changes)
    )


def test_ndt_equals_numpy_at_a_pose_and_at_the_fixed_point(clouds, start, align_jit):
    source, target = clouds
    points, oracle = np.asarray(source.position).T, Ndt(np.asarray(target.position).T)
    world = jax.jit(registration.build)(target, as_arrays(MAP.replace(method="ndt", resolution=SIZE)))
    pose = np.asarray(start.as_matrix())
    once = align_jit(source, world, start=start, params=as_arrays(AlignParams(factor=FACTOR, max_iterations=1)))
    hessian, gradient, cost = oracle(points, pose)
    np.testing.assert_allclose(once.hessian, hessian, rtol=0, atol=1e-8 * np.abs(hessian).max())
    np.testing.assert_allclose(once.gradient, gradient, rtol=0, atol=1e-8 * np.abs(gradient).max())
    assert float(once.cost) == pytest.approx(cost, rel=1e-8)
    held, means, omegas = oracle.pairs(points, pose)
    slope = [
        sum(sign * oracle.score(held, step(pose, sign * 1e-6 * axis), means, omegas).sum() for sign in (1, -1)) / 2e-6
        for axis in np.eye(6)
    ]
    np.testing.assert_allclose(gradient, slope, rtol=1e-5, atol=1e-5 * np.abs(gradient).max())
    found = align_jit(source, world, start=start, params=tight())
    assert bool(found.converged)
    expected = fixed_point(lambda pose: oracle(points, pose), np.asarray(found.pose.as_matrix()))
    np.testing.assert_allclose(found.pose.as_matrix(), expected, atol=1e-8)


def test_gicp_equals_numpy_with_the_nearest_points_of_a_tree(clouds, start, align_jit, truth):
    source, target = clouds
    world = jax.jit(registration.build)(target, as_arrays(MAP.replace(method="gicp", resolution=SIZE, per_voxel=32)))
    assert int(world.left_out) == 0
    points, others = np.asarray(source.position).T, np.asarray(target.position).T
    full = [np.asarray(c.covariance).T[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3) for c in clouds]
    tree = cKDTree(others)

    def oracle(pose: np.ndarray):
        distance, index = tree.query(points @ pose[:3, :3].T + pose[:3, 3], distance_upper_bound=REACH)
        kept = np.isfinite(distance)
        turned = pose[:3, :3] @ full[0][kept] @ pose[:3, :3].T
        omegas = np.linalg.inv(full[1][index[kept]] + turned)
        return system(points[kept], pose, others[index[kept]], omegas, np.ones(kept.sum()))

    params = as_arrays(AlignParams(factor=FACTOR, neighbours=27, max_iterations=1))
    once = align_jit(source, world, start=start, params=params)
    hessian, gradient, cost = oracle(np.asarray(start.as_matrix()))
    np.testing.assert_allclose(once.hessian, hessian, rtol=0, atol=1e-9 * np.abs(hessian).max())
    np.testing.assert_allclose(once.gradient, gradient, rtol=0, atol=1e-9 * np.abs(gradient).max())
    assert float(once.cost) == pytest.approx(cost, rel=1e-9)
    found = align_jit(source, world, start=start, params=tight(neighbours=27))
    assert bool(found.converged)
    expected = fixed_point(oracle, np.asarray(found.pose.as_matrix()))
    np.testing.assert_allclose(found.pose.as_matrix(), expected, atol=1e-8)
    off = np.linalg.inv(expected) @ np.asarray(truth.as_matrix())
    assert np.linalg.norm(off[:3, 3]) < 0.05
    assert np.degrees(Rotation.from_matrix(off[:3, :3]).magnitude()) < 0.5


def test_a_gicp_map_counts_what_its_voxels_cannot_hold(pair, build_jit):
    target = pair[1]
    world = build_jit(target, as_arrays(MAP.replace(method="gicp", per_voxel=2)))
    cells = np.floor(np.asarray(target.position).T / 2.0).astype(int)
    _, counts = np.unique(cells, axis=0, return_counts=True)
    assert int(world.left_out) == np.maximum(counts - 2, 0).sum()
    assert len(np.unique(np.asarray(world.lists)[:-1])) - 1 == np.minimum(counts, 2).sum()
