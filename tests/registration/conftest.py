"""A courtyard of planes, seen from two places."""

import jax
import jax.numpy as jnp
import jaxlie
import numpy as np
import pytest

from urbanjax import registration
from urbanjax.registration.features import FeatureParams, features
from urbanjax.types import as_arrays

MAP = registration.MapParams(resolution=2.0, shape=(32, 32, 8))


def courtyard(n: int, seed: int, noise: float = 0.01) -> np.ndarray:
    """n points [n, 3] on the ground, four walls of different distance and a slanted roof."""
    rng = np.random.default_rng(seed)
    u, v = rng.uniform(-1, 1, (2, n))
    faces = [
        np.stack([12 * u, 9 * v, 0 * u], 1),
        np.stack([0 * u + 12, 9 * u, 2 + 2 * v], 1),
        np.stack([0 * u - 11, 9 * u, 2 + 2 * v], 1),
        np.stack([12 * u, 0 * u + 9, 2 + 2 * v], 1),
        np.stack([12 * u, 0 * u - 8, 2 + 2 * v], 1),
        np.stack([4 * u + 5, 3 * v, 3 + 0.3 * u + 0.2 * v], 1),
    ]
    points = np.choose(rng.integers(0, len(faces), n)[:, None], faces)
    return points + noise * rng.normal(size=points.shape)


def covered(points: np.ndarray, dtype=jnp.float32) -> registration.PointCloud:
    """The cloud of `points` with features; in the dtype."""
    bare = registration.cloud(jnp.asarray(points, dtype))
    return jax.jit(features)(bare, as_arrays(FeatureParams(), dtype))[0]


@pytest.fixture(scope="session")
def truth() -> jaxlie.SE3:
    """T_map_body of the second view."""
    return jaxlie.SE3.from_rotation_and_translation(
        jaxlie.SO3.from_rpy_radians(0.01, -0.02, 0.06), jnp.array([0.5, -0.35, 0.08])
    )


@pytest.fixture(scope="session")
def pair(truth) -> tuple[registration.PointCloud, registration.PointCloud]:
    """Source (in its body frame) and target (in the map frame), 1000 points each."""
    back = np.asarray(truth.inverse().as_matrix(), float)
    seen = courtyard(1000, 1) @ back[:3, :3].T + back[:3, 3]
    return covered(seen), covered(courtyard(1000, 2))


@pytest.fixture(scope="session")
def align_jit():
    return jax.jit(registration.align)


@pytest.fixture(scope="session")
def build_jit():
    return jax.jit(registration.build)
