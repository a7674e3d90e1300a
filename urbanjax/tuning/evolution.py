"""Whether a gradient points where losses fall: beside the differences of an evolution strategy."""

from collections.abc import Callable

import numpy as np

COUNT = 8  # directions, of each of which the loss is asked on both sides


def cosine_to_evolution(
    loss: Callable[[np.ndarray], np.ndarray],
    z: np.ndarray,
    *,
    gradient: np.ndarray,
    sigma: float,
    seed: int,
    count: int = COUNT,
) -> float:
    """Cosine between a gradient and that of an evolution strategy, within the directions that the latter looked in.

    Antithetic differences (Salimans 2017) along orthogonal directions: they are the gradient of the loss smoothed over
    sigma, hard choices and all, and see nothing across. With as many directions as parameters that is all of it. NaN
    where either vanishes. Args: loss, the losses [N] of points [N, P]; z [P], where; gradient [P] there; sigma, how far
    is looked, in units of z; seed, of the directions; count, of them, at most P.
    """
    size = len(z)
    drawn = np.random.default_rng(seed).normal(size=(size, min(count, size)))
    directions = np.linalg.qr(drawn)[0].T
    values = np.asarray(loss(np.concatenate([z + sigma * directions, z - sigma * directions])), float)
    differences = (values[: len(directions)] - values[len(directions) :]) / (2 * sigma)
    slopes = directions @ np.asarray(gradient, float)
    size_of_both = np.linalg.norm(differences) * np.linalg.norm(slopes)
    return float(differences @ slopes / size_of_both) if size_of_both > 0 else float("nan")
