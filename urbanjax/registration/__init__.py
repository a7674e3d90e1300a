"""Point-to-distribution registration: a scan against a map of distributions (Eq. 1-5)."""

from urbanjax.registration.align import Alignment, AlignParams, align, align_starts
from urbanjax.registration.covariance import CovarianceParams
from urbanjax.registration.degeneracy import Degeneracy, DegeneracyParams, degeneracy
from urbanjax.registration.distributions import DistributionMap, MapParams, build
from urbanjax.registration.points import PointCloud, cloud, padded
from urbanjax.registration.preprocess import Preprocessing, PreprocessParams, preprocess
from urbanjax.registration.register import DroppedPointsWarning, Registration, register

__all__ = [
    "AlignParams",
    "Alignment",
    "CovarianceParams",
    "Degeneracy",
    "DegeneracyParams",
    "DistributionMap",
    "DroppedPointsWarning",
    "MapParams",
    "PointCloud",
    "PreprocessParams",
    "Preprocessing",
    "Registration",
    "align",
    "align_starts",
    "build",
    "cloud",
    "degeneracy",
    "padded",
    "preprocess",
    "register",
]
