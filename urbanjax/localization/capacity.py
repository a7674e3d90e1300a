"""Capacities of the localizer that hold what there is: chosen on the host, before anything is compiled."""

from collections.abc import Sequence

import numpy as np

from urbanjax.localization.lidar import LidarLocalizerParams
from urbanjax.registration.downsample import voxels
from urbanjax.registration.register import size
from urbanjax.registration.voxelmap import CutParams, VoxelMap

SPARE = 1.25  # of what the fullest of the scans needs, for fuller ones to come


def fitted(
    params: LidarLocalizerParams, *, world: VoxelMap | None = None, scans: Sequence[np.ndarray] = ()
) -> LidarLocalizerParams:
    """The params with capacities for a map and for scans like these, where none are set.

    Args: world, the point-cloud map; scans, the points [N, 3] m of some of them, as far as they are looked at.
    """
    thinning, cut = params.preprocess.downsample, params.sliding.cut
    if thinning.capacity is None and len(scans):
        most = max(voxels(points, float(thinning.resolution)) for points in scans)
        thinning = thinning.replace(capacity=size(int(SPARE * most)))
    if cut.capacity is None and world is not None:
        cut = cut.replace(capacity=size(fullest_window(world, params=cut)))
    return params.replace(
        preprocess=params.preprocess.replace(downsample=thinning), sliding=params.sliding.replace(cut=cut)
    )


def fullest_window(world: VoxelMap, *, params: CutParams) -> int:
    """The most voxels that the tiles under a window hold, wherever it lies.

    Args: world, the point-cloud map; params, the window's shape.
    """
    count = np.diff(np.asarray(world.start, np.int64), axis=1)
    total = np.pad(count.cumsum(0).cumsum(1), ((1, 0), (1, 0)))
    # Tiles that a window may touch along y and x.
    y, x = (min(-(-params.shape[i] // world.tile) + 1, count.shape[1 - i]) for i in (1, 0))
    inside = total[y:, x:] - total[:-y, x:] - total[y:, :-x] + total[:-y, :-x]
    return int(inside.max())
