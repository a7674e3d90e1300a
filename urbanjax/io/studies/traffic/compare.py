"""Teams against each other, pair by pair: divergences with intervals and nulls, and distances between their routes."""

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import Any, no_type_check

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from urbanjax.io.studies.traffic.deals import swapped
from urbanjax.io.studies.traffic.study import TrafficStudy
from urbanjax.io.studies.traffic.teams import Teams
from urbanjax.numerics import masked
from urbanjax.traffic import similarity
from urbanjax.traffic.course.areas import inside
from urbanjax.traffic.divergence.conditional import Conditional, conditional
from urbanjax.traffic.divergence.dimension import effective_dimension
from urbanjax.traffic.divergence.estimate import DivergenceParams, Estimate, all_pairs, divergence
from urbanjax.traffic.divergence.neighbours import Pairs, distances, neighbours
from urbanjax.traffic.resampling import Interval, LapSwap, ResamplingParams, interval
from urbanjax.types import ConfigError, as_arrays
from urbanjax.types.errors import TrafficError

Tick = Callable[[str, float | None], None]


@no_type_check
@dataclasses.dataclass(frozen=True)
class Comparison:
    """P ordered pairs of T teams, K values of k, A areas."""

    pairs: Pairs
    ks: tuple[int, ...]  # a single 0 for adaptive neighbourhoods
    estimate: Estimate  # [P, K]
    interval: Interval  # [P, K + 1], the last one of the mean distance
    swap: LapSwap  # observed [P, K + 1], null [P, S, K + 1]: divergences, and the conditional one for the middle k
    given: Conditional  # [P, K], P(x | z)
    dimension: np.ndarray  # [T]
    routes: similarity.Similarity  # [P], against the line through the other's samples
    samples: dict[str, np.ndarray]  # mean, rmse, hausdorff [P] m, against the other's samples
    areas: dict[str, np.ndarray]  # value, mean, rmse [A, P]; valid [A, P]; samples [A, T]

    @property
    def middle(self) -> int:
        """Which of the values of k is shown where there is room for one."""
        return len(self.ks) // 2


def compare(study: TrafficStudy, teams: Teams, tick: Tick) -> Comparison:
    """All comparisons of the teams."""
    pairs, key = all_pairs(len(teams.names)), jax.random.key(study.seed)
    params = as_arrays(study.teams.divergence)
    points, valid = jnp.asarray(teams.points), jnp.asarray(teams.valid)
    station_bin, bins = _bins(study, teams)
    arrays = points, valid, jnp.asarray(teams.offset), station_bin
    tick("divergences", 0.1)
    estimate = _divergence(points, valid, params, pairs, key)
    if params.ties == "error":
        _refuse_ties(teams, estimate, pairs)
    tick("P(x | z)", 0.2)
    given = _conditional(arrays[2], station_bin, valid, bins, params, pairs, key)
    tick("intervals", 0.3)
    block, resampling = _blocks(study, teams)
    found = _interval(points, valid, block, params, as_arrays(resampling), pairs, key)
    tick("laps dealt out anew", 0.6)
    swap = swapped(study, teams, params, arrays, bins, pairs)
    tick("routes", 0.8)
    first, second = (np.array(side) for side in zip(*pairs, strict=True))
    return Comparison(
        pairs=pairs,
        ks=(0,) if params.form == "adaptive" else params.ks,
        estimate=jax.device_get(estimate),
        interval=jax.device_get(found),
        swap=swap,
        given=jax.device_get(given),
        dimension=np.asarray(_dimension(points, valid)),
        routes=jax.device_get(_routes(points[first], points[second], valid[first], valid[second])),
        samples={name: np.asarray(v) for name, v in _distances(points, valid, pairs).items()},
        areas=_by_area(teams, params, pairs, key),
    )


def _refuse_ties(teams: Teams, estimate: Estimate, pairs: Pairs) -> None:
    """Raise TrafficError where samples coincide, naming the first pair that they are of."""
    own, other = (np.asarray(ties).max(1) for ties in (estimate.ties_own, estimate.ties_other))
    for (i, j), mine, theirs in zip(pairs, own, other, strict=True):
        if mine or theirs:
            raise TrafficError(
                f"teams: {mine} samples of {teams.names[i]} coincide with their neighbours, {theirs} with those of "
                f"{teams.names[j]}: set 'teams.divergence.ties' to dedupe, jitter or floor"
            )


_divergence = jax.jit(divergence, static_argnums=3)
_conditional = jax.jit(conditional, static_argnums=(3, 5))
_dimension = jax.jit(effective_dimension)


@jax.jit
def _routes(x: Array, y: Array, x_mask: Array, y_mask: Array) -> similarity.Similarity:
    return jax.lax.map(lambda pair: similarity.between_lines(*pair), (x, y, x_mask, y_mask))


def _nearest(points: Array, valid: Array, pairs: Pairs) -> tuple[Array, Array]:
    """Distance [P, n] of each sample to the nearest one of the other team, and which count."""
    away, found = distances(points, pairs, neighbours(points, valid, pairs, (1,)))
    return away[:, 0], found[:, 0]


@partial(jax.jit, static_argnums=2)
def _distances(points: Array, valid: Array, pairs: Pairs) -> dict[str, Array]:
    """Eq. 33 and its relatives over the samples, [P] each."""
    away, found = _nearest(points, valid, pairs)
    return {
        "mean": masked.mean(away, found),
        "rmse": masked.rms(away, found),
        "hausdorff": masked.largest(away, found),
    }


@partial(jax.jit, static_argnums=5)
def _interval(
    points: Array, valid: Array, block: Array, params: DivergenceParams, resampling: Any, pairs: Pairs, key: Array
) -> Interval:
    """Intervals of divergences and of the mean distance; all teams keep the same blocks."""

    def statistic(mask: Array) -> tuple[Array, Array]:
        found = divergence(points, mask, params, pairs, key)
        away, near = _nearest(points, mask, pairs)
        mean = masked.mean(away, near)[:, None]
        return jnp.concatenate([found.value, mean], 1), jnp.concatenate([found.valid, near.any(1, keepdims=True)], 1)

    return interval(statistic, valid, block, jax.random.fold_in(key, 1), resampling, paired=True)


def _bins(study: TrafficStudy, teams: Teams) -> tuple[Array, int]:
    """The station bin of each sample, and how many there are."""
    count = max(round(teams.length / float(study.teams.bin_length)), 1)
    return jnp.clip(jnp.asarray(teams.station * (count / teams.length), jnp.int32), 0, count - 1), count


def _blocks(study: TrafficStudy, teams: Teams) -> tuple[Array, ResamplingParams]:
    """The block of each sample: its piece of the course, each with as many samples of all teams, or its run."""
    params = study.teams.resampling
    if study.teams.blocks == "runs":
        runs = int(teams.runs.max())
        if runs < 2:
            raise ConfigError("'teams.blocks': every team has one run, which gives no blocks; set it to stations")
        return jnp.asarray(teams.run), params.replace(blocks=runs)
    ends = np.quantile(teams.station[teams.valid], np.arange(1, params.blocks) / params.blocks)
    return jnp.asarray(np.searchsorted(ends, teams.station), jnp.int32), params


def _by_area(teams: Teams, params: DivergenceParams, pairs: Pairs, key: Array) -> dict[str, np.ndarray]:
    """Divergence, mean and root mean square distance in each area, [A, P]."""
    within = jax.vmap(lambda station: inside(teams.areas, station))(jnp.asarray(teams.station))
    masks = jnp.moveaxis(within, 1, 0) & jnp.asarray(teams.valid)[None]
    found = _each_area(jnp.asarray(teams.points), masks, params, pairs, key)
    return {name: np.asarray(value) for name, value in found.items()}


@partial(jax.jit, static_argnums=3)
def _each_area(points: Array, masks: Array, params: DivergenceParams, pairs: Pairs, key: Array) -> dict[str, Array]:
    def area(mask: Array) -> dict[str, Array]:
        found = divergence(points, mask, params, pairs, key)
        away, near = _nearest(points, mask, pairs)
        middle = found.value.shape[1] // 2
        return {
            "value": found.value[:, middle],
            "valid": found.valid[:, middle],
            "mean": masked.mean(away, near),
            "rmse": masked.rms(away, near),
            "near": near.any(1),
            "samples": mask.sum(1),
        }

    return jax.lax.map(area, masks)
