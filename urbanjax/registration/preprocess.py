"""From raw points to a cloud that can be registered."""

from jax import Array
from jaxtyping import Bool, Float

from urbanjax.registration.downsample import DownsampleParams, downsample
from urbanjax.registration.features import FeatureParams, features
from urbanjax.registration.points import PointCloud
from urbanjax.types import pytree


@pytree
class PreprocessParams:
    """Down-sampling and surface features."""

    downsample: DownsampleParams = DownsampleParams()
    features: FeatureParams = FeatureParams()


@pytree
class Preprocessing:
    """What became of the points."""

    dropped: Array  # [] voxels for which there was no place in the capacity
    certain: Array  # [] share of the points whose neighbours are certainly the nearest ones


def preprocess(
    position: Float[Array, "n 3"], valid: Bool[Array, " n"], *, params: PreprocessParams | None = None
) -> tuple[PointCloud, Preprocessing]:
    """Voxel means with normals and plane-regularised covariances.

    Args: position [N, 3] m, padded with invalid points; valid [N] bool.
    """
    params = PreprocessParams() if params is None else params
    thinned, dropped = downsample(position, valid, params=params.downsample)
    cloud, certain = features(thinned, params.features)
    return cloud, Preprocessing(dropped, certain)
