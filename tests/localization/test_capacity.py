"""Capacities hold what there is, wherever the window lies, and what a caller set stays."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.localization.capacity import SPARE, fitted, fullest_window
from urbanjax.localization.lidar import LidarLocalizerParams
from urbanjax.registration import MapParams
from urbanjax.registration.downsample import DownsampleParams, downsample
from urbanjax.registration.voxelmap import CutParams, cut, voxelise

SHAPE = (16, 12, 16)


@pytest.fixture(scope="module")
def world():
    """More voxels in one corner than elsewhere."""
    rng = np.random.default_rng(0)
    position = rng.uniform([-40, -30, -2], [40, 30, 3], (3000, 3)) * rng.uniform(0.2, 1, (3000, 1))
    return voxelise(position, np.zeros((3000, 6)), count=np.ones(3000), params=MapParams(), tile=4)


def test_no_window_misses_a_voxel_and_one_needs_them_all(world):
    most = fullest_window(world, params=CutParams(shape=SHAPE))
    look = jax.jit(
        lambda centre, params: cut(world, centre, radius=jnp.asarray(50.0), params=params)[1], static_argnums=1
    )
    short, missed = [], []
    for centre in np.random.default_rng(1).uniform(-40, 40, (300, 3)) * [1, 0.8, 0]:
        missed.append(int(look(jnp.asarray(centre, jnp.float32), CutParams(capacity=most, shape=SHAPE))))
        short.append(int(look(jnp.asarray(centre, jnp.float32), CutParams(capacity=int(0.9 * most), shape=SHAPE))))
    assert max(missed) == 0
    assert max(short) > 0


def test_a_map_smaller_than_the_window(world):
    wide = CutParams(shape=(256, 256, 16))
    assert fullest_window(world, params=wide) == world.cell.shape[0]


def test_what_is_not_set_is_chosen_and_what_is_set_stays(world):
    points = np.random.default_rng(2).uniform(-30, 30, (4000, 3))
    free = LidarLocalizerParams()
    chosen = fitted(free, world=world, scans=[points[:100], points])
    thinning = DownsampleParams(resolution=free.preprocess.downsample.resolution)
    kept, _ = downsample(jnp.asarray(points, jnp.float32), jnp.ones(len(points), bool), params=thinning)
    need = int(kept.valid.sum())
    assert SPARE * need <= chosen.capacity <= 1.3 * SPARE * need
    assert chosen.sliding.cut.capacity >= fullest_window(world, params=free.sliding.cut)
    again = dataclasses.replace(chosen, drift=0.02)
    assert fitted(again, world=world, scans=[points[:100]]) == again
    assert fitted(free) == free
    assert (free.capacity, free.sliding.cut.size) == (8192, 32768)
