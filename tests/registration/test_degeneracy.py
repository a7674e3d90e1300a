"""Corridor, plane and box: the directions that nothing is known about are the right ones."""

import jax
import jaxlie
import numpy as np
import pytest

from tests.registration.conftest import MAP, covered
from urbanjax.registration import AlignParams
from urbanjax.registration.degeneracy import degeneracy
from urbanjax.types import as_arrays

degeneracy_jit = jax.jit(degeneracy)


def faces(seed: int, walls: str, size: float = 1.0) -> np.ndarray:
    """1000 points on the ground (g), walls along x (w) and at both ends (e), 2 cm thick; `size` scales the world."""
    rng = np.random.default_rng(seed)
    u, v = rng.uniform(-1, 1, (2, 1000))
    planes = {
        "g": [np.stack([14 * u, 6 * v, 0 * u - 1], 1)],
        "w": [np.stack([14 * u, 0 * u + side, 1 + 2 * v], 1) for side in (-6, 6)],
        "e": [np.stack([0 * u + side, 6 * u, 1 + 2 * v], 1) for side in (-14, 14)],
    }
    chosen = [plane for name in walls for plane in planes[name]]
    points = np.choose(rng.integers(0, len(chosen), 1000)[:, None], chosen)
    return size * points + 0.01 * rng.normal(size=points.shape)


def seen(walls: str, align_jit, build_jit, size: float = 1.0):
    world = build_jit(covered(faces(1, walls, size)), as_arrays(MAP))
    found = align_jit(
        covered(faces(2, walls, size)), world, start=jaxlie.SE3.identity(), params=as_arrays(AlignParams())
    )
    return degeneracy_jit(found.hessian)


@pytest.mark.parametrize("size", [1.0, 0.5])
def test_an_open_box_is_known_in_all_directions(size, align_jit, build_jit):
    found = seen("gwe", align_jit, build_jit, size)
    assert not np.any(found.translation.degenerate)
    assert not np.any(found.rotation.degenerate)
    assert float(found.translation.share.sum()) == pytest.approx(1, abs=1e-5)


@pytest.mark.parametrize("size", [1.0, 0.5])
def test_a_corridor_says_nothing_about_the_way_along_it(size, align_jit, build_jit):
    found = seen("gw", align_jit, build_jit, size)
    assert found.translation.degenerate.tolist() == [True, False, False]
    assert abs(float(found.translation.axes[0, 0])) > 0.999
    assert not np.any(found.rotation.degenerate)


def test_a_plane_says_nothing_about_position_on_it_and_heading(align_jit, build_jit):
    found = seen("g", align_jit, build_jit)
    assert found.translation.degenerate.tolist() == [True, True, False]
    assert abs(float(found.translation.axes[2, 2])) > 0.999
    assert found.rotation.degenerate.tolist() == [True, False, False]
    assert abs(float(found.rotation.axes[0, 2])) > 0.999


def test_no_information_at_all_is_finite():
    found = degeneracy_jit(np.zeros((6, 6), np.float32))
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(found))
    assert np.all(found.translation.degenerate)
