"""Kriging of values and slopes: a Gaussian process that takes gradients in where there are some (host side)."""

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_triangular

from urbanjax.types import host_record

LENGTHS = (0.4, 0.7, 1.2, 2.0)  # of which the likeliest is taken; all numbers lie between -1 and 1
UNLIKE = 3.0  # times at most that the length of a number is shorter or longer than that
NOISE = 0.1  # of the deviation: what is smooth in a drive has kinks still
SLOPE_NOISES = (0.3, 3.0, 30.0)  # of the deviation per length; of the last, slopes tell nothing
LEAST = 1e-3  # of deviations


@host_record
class Observed:
    """Values of N points, and slopes of M of them."""

    points: Float[np.ndarray, "n p"]
    values: Float[np.ndarray, " n"]
    slopes: Float[np.ndarray, "m p"]
    sloped: np.ndarray  # [M], which points these are of


@host_record
class Kriging:
    """What observations say of anywhere else."""

    observed: Observed
    lengths: Float[np.ndarray, " p"]
    mean: float
    deviation: float
    factor: Float[np.ndarray, "k k"]  # lower triangular, of the covariance of all observations
    weights: Float[np.ndarray, " k"]
    slope_noise: float

    @property
    def trusts(self) -> bool:
        """Whether slopes agree so well with values that they tell anything."""
        return self.slope_noise < SLOPE_NOISES[-1]

    def at(self, points: Float[np.ndarray, "q p"]) -> tuple[np.ndarray, np.ndarray]:
        """Mean [Q] and deviation [Q] of the value at points. Args: points [Q, P], between -1 and 1."""
        x, own = points / self.lengths, self.observed.points / self.lengths
        cross = np.concatenate([_values(x, own), _values_and_slopes(x, own[self.observed.sloped])], axis=1)
        explained = solve_triangular(self.factor, cross.T, lower=True)
        left = np.maximum(1 - (explained**2).sum(0), LEAST**2)
        return self.mean + self.deviation * cross @ self.weights, self.deviation * np.sqrt(left)


def krige(observed: Observed) -> Kriging:
    """The likeliest model among those of a few lengths, which trust slopes more or less, or not at all.

    Numbers along which trusted slopes are steep have shorter lengths. Args: observed, at least one value.
    """
    shares, alike = _shares(observed), np.ones(observed.points.shape[1])
    noises = SLOPE_NOISES if len(observed.slopes) else SLOPE_NOISES[:1]
    models = [
        _fitted(observed, length * (alike if noise == SLOPE_NOISES[-1] else shares), noise)
        for noise in noises
        for length in LENGTHS
    ]
    return max(models, key=lambda pair: pair[0])[1]


def _shares(observed: Observed) -> np.ndarray:
    """The length of each number, [P], of the common one."""
    steep = np.sqrt(np.mean(observed.slopes**2, axis=0)) if len(observed.slopes) else np.zeros(0)
    if not steep.size or not steep.max() > 0:
        return np.ones(observed.points.shape[1])
    usual = np.exp(np.mean(np.log(np.maximum(steep, LEAST * steep.max()))))
    return np.clip(usual / np.maximum(steep, LEAST * steep.max()), 1 / UNLIKE, UNLIKE)


def _fitted(observed: Observed, lengths: np.ndarray, slope_noise: float) -> tuple[float, Kriging]:
    """The likelihood's logarithm, and the model with these lengths."""
    mean, deviation = float(observed.values.mean()), max(float(observed.values.std()), LEAST)
    x = observed.points / lengths
    s = x[observed.sloped]
    mixed = _values_and_slopes(x, s)
    covariance = np.block([[_values(x, x), mixed], [mixed.T, _slopes(s)]])
    noise = np.concatenate([np.full(len(x), NOISE), np.full(s.size, slope_noise)])
    factor = np.linalg.cholesky(covariance + np.diag(noise**2))
    told = np.concatenate([observed.values - mean, (observed.slopes * lengths).reshape(-1)]) / deviation
    white = solve_triangular(factor, told, lower=True)
    likelihood = -0.5 * float(white @ white) - float(np.log(np.diag(factor)).sum())
    weights = solve_triangular(factor, white, lower=True, trans=1)
    # Slopes are told per length, so that models of other lengths are of other data: the volume makes up for that.
    volume = float(np.log(lengths).sum()) * len(s)
    return likelihood + volume, Kriging(observed, lengths, mean, deviation, factor, weights, slope_noise)


def _values(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Covariance [N, M] of values at x [N, P] and y [M, P]."""
    return np.exp(-0.5 * ((x[:, None] - y[None]) ** 2).sum(-1))


def _values_and_slopes(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Covariance [N, M P] of values at x [N, P] and slopes at y [M, P]."""
    apart = x[:, None] - y[None]
    return (apart * _values(x, y)[..., None]).reshape(len(x), -1)


def _slopes(x: np.ndarray) -> np.ndarray:
    """Covariance [M P, M P] of slopes at x [M, P]."""
    n, p = x.shape
    apart = x[:, None] - x[None]
    blocks = (np.eye(p) - apart[..., :, None] * apart[..., None, :]) * _values(x, x)[..., None, None]
    return blocks.transpose(0, 2, 1, 3).reshape(n * p, n * p)
