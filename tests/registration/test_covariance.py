"""The stated covariance holds the errors: in open worlds, along corridors and planes, and where nothing is seen."""

import jax
import jax.numpy as jnp
import jaxlie
import numpy as np
import pytest
from scipy import stats

from tests.registration.conftest import MAP
from urbanjax import registration
from urbanjax.registration import AlignParams, CovarianceParams
from urbanjax.registration.features import FeatureParams, features
from urbanjax.types import as_arrays

SCAN, WORLD = 1000, 3000  # points
PRIOR = np.repeat([CovarianceParams().prior_rotation, CovarianceParams().prior_translation], 3)
Face = tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]


def wall(x: float, y: float, half_x: float, half_y: float) -> Face:
    """Centre, half the horizontal edge and half the vertical one, 4 m high."""
    return (x, y, 1), (half_x, half_y, 0), (0, 0, 2)


def ground(half_x: float, half_y: float) -> Face:
    return (0, 0, -1), (half_x, 0, 0), (0, half_y, 0)


SIDES = [wall(0, side, 20, 0) for side in (-6, 6)]
ENDS = [wall(side, 0, 0, 6) for side in (-14, 14)]
WORLDS = {
    "plane": [ground(14, 14)],
    "corridor": [ground(20, 6), *SIDES],
    "box": [ground(14, 6), *SIDES, *ENDS],
    "street": [ground(20, 6), *SIDES, *(wall(x, y, 0, 0.4) for x in (-15, -7, 2, 9, 16) for y in (-5.6, 5.6))],
    "crossing": [
        ground(20, 20),
        *(wall(13 * x, 6 * y, 7, 0) for x in (-1, 1) for y in (-1, 1)),
        *(wall(6 * x, 13 * y, 0, 7) for x in (-1, 1) for y in (-1, 1)),
    ],
}


def drawn(rng: np.random.Generator, world: list[Face], n: int, noise: float) -> np.ndarray:
    """n points [n, 3] by area."""
    centre, *edges = (np.array(part, float) for part in zip(*world, strict=True))
    area = np.prod([np.linalg.norm(edge, axis=1) for edge in edges], axis=0)
    face = rng.choice(len(world), n, p=area / area.sum())
    on_face = centre[face] + sum(rng.uniform(-1, 1, (n, 1)) * edge[face] for edge in edges)
    return on_face + noise * rng.normal(size=(n, 3))


@pytest.fixture(scope="module")
def register():
    """A function of the points [SCAN, 3] seen, which of them count, map, truth and start: error and covariance.

    Truth is given as roll, pitch, yaw, x, y, z, the start as [omega; v] from there.
    """

    @jax.jit
    def errors(points, valid, world, truth, off):
        rotation = jaxlie.SO3.from_rpy_radians(truth[0], truth[1], truth[2])
        T_map_body = jaxlie.SE3.from_rotation_and_translation(rotation, truth[3:])
        start = T_map_body @ jaxlie.SE3.exp(jnp.concatenate([off[3:], off[:3]]))
        seen, mapped = (
            features(registration.cloud(points, valid=good), as_arrays(FeatureParams()))[0]
            for points, good in ((jax.vmap(T_map_body.inverse().apply)(points), valid), (world, jnp.ones(WORLD, bool)))
        )
        maps = as_arrays(MAP.replace(resolution=1.0, shape=(64, 64, 16)))
        found = registration.align(seen, registration.build(mapped, maps), start=start, params=as_arrays(AlignParams()))
        twist = (found.pose.inverse() @ T_map_body).log()
        return jnp.concatenate([twist[3:], twist[:3]]), found.covariance

    return lambda *arguments: jax.device_get(errors(*jax.tree.map(jnp.asarray, arguments)))


def squared(register, name: str, seed: int) -> float:
    """The normalised squared error of a map, a scan, a pose and a start drawn anew."""
    rng = np.random.default_rng((7, list(WORLDS).index(name), seed))
    noise, n_points = rng.choice([0.01, 0.02, 0.03]), rng.choice([300, 1000])
    truth = rng.normal(size=6) * [0.02, 0.02, 0, 0, 0, 0] + rng.uniform(-1, 1, 6) * [0, 0, np.pi, 1, 1, 0.2]
    scan, world = (drawn(rng, WORLDS[name], n, noise) for n in (SCAN, WORLD))
    error, covariance = register(scan, np.arange(SCAN) < n_points, world, truth, PRIOR * rng.normal(size=6))
    error, covariance = error.astype(float), covariance.astype(float)
    return float(error @ np.linalg.solve(covariance, error))


@pytest.mark.parametrize(("count", "least"), [(12, 0.6), pytest.param(100, 0.85, marks=pytest.mark.slow)])
def test_nineteen_of_twenty_errors_lie_in_their_ellipsoid(count, least, register):
    limit = stats.chi2.ppf(0.95, 6)
    shares = {name: np.mean([squared(register, name, n) <= limit for n in range(count)]) for name in WORLDS}
    assert min(shares.values()) > least, shares
    assert 0.90 <= np.mean(list(shares.values())) <= 0.98, shares


def test_what_is_not_seen_is_as_unsure_as_the_start_and_the_rest_is_not(register):
    unseen = {"plane": [2, 3, 4], "corridor": [3], "box": []}  # yaw and the two ways on a plane, the way along
    for name, twists in unseen.items():
        rng = np.random.default_rng(0)
        scan, world = (drawn(rng, WORLDS[name], n, 0.02) for n in (SCAN, WORLD))
        _, covariance = register(scan, np.ones(SCAN, bool), world, np.zeros(6), np.zeros(6))
        share = np.sqrt(np.diagonal(covariance)) / PRIOR
        np.testing.assert_allclose(share[twists], 1, rtol=0.05)
        assert np.all(np.delete(share, twists) < 0.05)


def test_the_floor_is_in_every_answer_and_the_prior_bounds_it(pair, align_jit, build_jit):
    source, target = pair
    world, here = build_jit(target, as_arrays(MAP)), jaxlie.SE3.identity()
    stated = []
    for floor in (0.0, 0.02):
        changed = CovarianceParams(floor_rotation=0.1 * floor, floor_translation=floor)
        found = align_jit(source, world, start=here, params=as_arrays(AlignParams(covariance=changed)))
        stated.append(np.asarray(found.covariance, float))
    np.testing.assert_allclose(stated[1] - stated[0], np.diag(np.repeat([4e-6, 4e-4], 3)), atol=1e-9)
    assert np.all(np.linalg.eigvalsh(np.diag(PRIOR**2) - stated[0]) > 0)
    assert np.all(np.linalg.eigvalsh(stated[0]) > 0)


@pytest.mark.parametrize("n_pairs", [0, 1, 2])
def test_pairs_that_any_pose_fits_say_nothing(n_pairs, pair, align_jit, build_jit):
    _, target = pair
    world, here, params = build_jit(target, as_arrays(MAP)), jaxlie.SE3.identity(), as_arrays(AlignParams())
    few = target.replace(valid=jnp.arange(target.valid.shape[0]) < n_pairs)
    found = align_jit(few, world, start=here, params=params)
    assert float(found.inliers) == n_pairs
    np.testing.assert_allclose(np.sqrt(np.diagonal(found.covariance)), PRIOR, rtol=1e-3)


def test_neither_the_scale_of_the_weights_nor_that_of_the_shapes_matters(pair, align_jit, build_jit):
    here, stated = jaxlie.SE3.identity(), []
    for scale in (1.0, 100.0):
        source, target = (cloud.replace(covariance=scale * cloud.covariance) for cloud in pair)
        params = as_arrays(AlignParams(damping=1e-3 / scale))
        found = align_jit(source, build_jit(target, as_arrays(MAP)), start=here, params=params)
        stated.append(found.covariance)
    np.testing.assert_allclose(stated[1], stated[0], rtol=2e-3, atol=1e-8)
