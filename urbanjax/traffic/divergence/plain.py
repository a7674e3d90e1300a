"""The divergence of two plain arrays, with its interval."""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from urbanjax.traffic.divergence.estimate import DivergenceParams, Estimate, divergence
from urbanjax.traffic.resampling import Interval, ResamplingParams, consecutive, interval
from urbanjax.types import as_arrays, pytree
from urbanjax.types.arguments import array, kind, whole
from urbanjax.types.errors import TrafficError

FARTHEST = 1e9  # m, as of logs
PAIR = ((0, 1),)


@pytree
class KlDivergence:
    """D(P || Q) in nats, with an interval; estimates are not clamped and may be negative where P and Q are alike."""

    value: float  # nats
    low: float  # nats, end of the interval
    high: float  # nats
    deviation: float  # nats, standard deviation of the estimate
    level: float  # nominal coverage of the interval
    samples: tuple[int, int]  # of P and of Q that were used
    dropped: tuple[int, int]  # that repeated another one, under ties="dedupe"

    def __str__(self) -> str:
        """One line."""
        interval = f"{100 * self.level:.0f} % interval {self.low:.3g} to {self.high:.3g}"
        return f"{self.value:.3g} nats, {interval} ({self.samples[0]} and {self.samples[1]} samples)"


def kl_divergence(
    p: Any,
    q: Any,
    *,
    k: int = 5,
    form: str = "corrected",
    ties: str = "error",
    resampling: ResamplingParams | None = None,
    seed: int = 0,
) -> KlDivergence:
    """How differently two vehicles drove: D(P || Q) from nearest neighbours (Eq. 30-32), of the places they were at.

    The interval is from half samples of blocks of consecutive samples, so that neighbours in time count as what they
    are; it does not know the estimator's bias (docs/divergence.md). For many pairs in one program take
    `traffic.divergence.estimate.divergence`.
    Args: p [N, D] and q [M, D] m, in the order driven, N and M need not be equal; k, neighbours; form, one of
    corrected, printed, adaptive; ties, what is done where a k-th neighbour is at distance 0, one of error, dedupe,
    jitter, floor; resampling, draws, blocks and level of the interval; seed of the draws. Raises TrafficError for
    arrays that are not [N, D], not finite, too short for k and the blocks, the same, or with such ties where that is an
    error.
    """
    sides = [_checked(points, name) for name, points in (("p", p), ("q", q))]
    if sides[0].shape[1] != sides[1].shape[1]:
        raise TrafficError(f"p has {sides[0].shape[1]} columns and q {sides[1].shape[1]}: they must be as many")
    k, seed = (
        whole(k, "k", error=TrafficError, least=1),
        whole(seed, "seed", error=TrafficError, least=0, most=2**32 - 1),
    )
    params = DivergenceParams(ks=(k,), form=form, ties=ties)
    resampling = ResamplingParams() if resampling is None else resampling
    kind(resampling, "resampling", wanted=ResamplingParams, error=TrafficError)
    same = len(np.unique(np.concatenate(sides), axis=0)) <= max(len(np.unique(side, axis=0)) for side in sides)
    if same:
        raise TrafficError("p and q hold the same samples: an estimate needs two runs, not one and itself")
    least = max(2 * (k + 2), resampling.blocks)
    for name, points in zip("pq", sides, strict=True):
        if len(points) < least:
            raise TrafficError(
                f"{name} has {len(points)} samples: k={k} neighbours in half of {resampling.blocks} blocks need {least}"
            )
    middle = np.concatenate(sides).mean(0)
    points = np.zeros((2, max(map(len, sides)), sides[0].shape[1]))
    valid = np.zeros(points.shape[:2], bool)
    for row, (mask, side) in enumerate(zip(valid, sides, strict=True)):
        points[row, : len(side)], mask[: len(side)] = side - middle, True
    arrays = as_arrays((points, params, resampling))
    estimate, found = _program(arrays[0], jnp.asarray(valid), jax.random.key(seed), *arrays[1:])
    if ties == "error" and int(estimate.ties_own.max() + estimate.ties_other.max()):
        count = int(estimate.ties_own.max()), int(estimate.ties_other.max())
        raise TrafficError(
            f"{count[0]} samples of p coincide with their neighbours in p, {count[1]} with those in q: set ties to "
            "dedupe, jitter or floor, or leave out where the vehicle stands"
        )
    if not bool(found.valid[0, 0]):
        raise TrafficError(
            "no estimate: too few samples differ; give more of them, fewer neighbours k, or fewer blocks"
        )
    counts = [len(side) for side in sides]
    dropped = tuple(int(n) for n in estimate.dropped)
    low, high, deviation = (float(x[0, 0]) for x in (found.low, found.high, found.deviation))
    return KlDivergence(
        value=float(estimate.value[0, 0]),
        low=low,
        high=high,
        deviation=deviation,
        level=float(resampling.level),
        samples=(counts[0] - dropped[0], counts[1] - dropped[1]),
        dropped=(dropped[0], dropped[1]),
    )


@jax.jit
def _program(
    points: Array, valid: Array, key: Array, params: DivergenceParams, resampling: ResamplingParams
) -> tuple[Estimate, Interval]:
    noise, draws = jax.random.split(key)
    estimate = functools.partial(divergence, points, params=params, pairs=PAIR, key=noise)

    def statistic(mask: Array) -> tuple[Array, Array]:
        found = estimate(mask)
        return found.value, found.valid

    block = consecutive(valid, resampling.blocks)
    return estimate(valid), interval(statistic, valid, block=block, key=draws, params=resampling)


def _checked(points: Any, name: str) -> np.ndarray:
    values = array(points, name, error=TrafficError)
    if values.ndim != 2 or not 1 <= values.shape[1] <= 3:
        raise TrafficError(f"{name} has the shape {values.shape}: positions [N, 2] are needed")
    if not len(values):
        raise TrafficError(f"{name} has no samples: positions [N, 2] are needed")
    if not np.isfinite(values).all():
        raise TrafficError(f"{name}: {int((~np.isfinite(values)).any(1).sum())} samples are not finite: leave them out")
    extent = float(np.abs(values).max())
    if extent > FARTHEST:
        raise TrafficError(f"{name} holds a coordinate of {extent:.3g} m, beyond {FARTHEST:g}: correct it, or its unit")
    return values
