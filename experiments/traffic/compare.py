"""Teams against each other, pair by pair: divergences with intervals and nulls, and distances between their routes."""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from experiments.traffic.deals import swapped
from experiments.traffic.study import TrafficStudy
from experiments.traffic.teams import Teams
from urbanjax.traffic import similarity
from urbanjax.traffic.course.areas import inside
from urbanjax.traffic.divergence.conditional import Conditional, conditional
from urbanjax.traffic.divergence.dimension import effective_dimension
from urbanjax.traffic.divergence.estimate import DivergenceParams, Estimate, all_pairs, divergence
from urbanjax.traffic.divergence.neighbours import Pairs, distances, neighbours
from urbanjax.traffic.resampling import Interval, LapSwap, ResamplingParams, half_samples, spread
from urbanjax.types import ConfigError, as_arrays, host_record
from urbanjax.types.errors import TrafficError

Tick = Callable[[str, float | None], None]


@host_record
class Comparison:
    """P ordered pairs of T teams, K values of k, A areas."""

    pairs: Pairs
    ks: tuple[int, ...]  # a single 0 for adaptive neighbourhoods
    estimate: Estimate  # [P, K]
    interval: Interval  # [P, K + 1], the last one of the mean distance
    swap: LapSwap  # observed [P, 2 K], null [P, S, 2 K]: divergences, then those given the station
    given: Conditional  # [P, K], P(x | z)
    dimension: np.ndarray  # [T]
    routes: similarity.Similarity  # [P], against the line through the other's samples
    samples: similarity.Distances  # [P], to the other's samples (Eq. 33)
    areas: dict[str, np.ndarray]  # value, mean, rmse [A, P]; valid, near [A, P]; samples [A, T]

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
    evaluate = partial(_evaluate, params=params, pairs=pairs, key=key)
    estimate, away, there = evaluate(points, valid)
    if params.ties == "error":
        _refuse_ties(teams, estimate, pairs)
    tick("P(x | z)", 0.2)
    given = _conditional(arrays[2], station_bin, valid=valid, bins=bins, params=params, pairs=pairs, key=key)
    block, resampling = _blocks(study, teams)
    masks = half_samples(valid, block, key=jax.random.fold_in(key, 1), params=resampling, paired=True)
    draws = []
    for k, mask in enumerate(masks):
        tick("intervals", 0.3 + 0.3 * k / len(masks))
        draws.append(_column(*evaluate(points, mask)))
    drawn, fine = (jnp.stack(side) for side in zip(*draws, strict=True))
    found = spread(*_column(estimate, away, there), drawn=drawn, fine=fine, params=resampling)
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
        samples=jax.device_get(away),
        areas=_by_area(teams, evaluate),
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


@partial(jax.jit, static_argnames="pairs")
def _evaluate(
    points: Array, mask: Array, params: DivergenceParams, pairs: Pairs, key: Array
) -> tuple[Estimate, similarity.Distances, Array]:
    """Divergences, distances to the other's samples [P], and where those are known, of the samples that count.

    One program for the whole, for areas and for draws.
    """
    away, found = distances(points, pairs, index=neighbours(points, mask, pairs=pairs, ranks=(1,)))
    near = similarity.summarised(away[:, 0], found[:, 0])
    return divergence(points, mask, params=params, pairs=pairs, key=key), near, jnp.any(found[:, 0], axis=-1)


def _column(estimate: Estimate, away: similarity.Distances, there: Array) -> tuple[Array, Array]:
    """Values [P, K + 1] and which are valid: the divergences and the mean distance."""
    values = jnp.concatenate([estimate.value, away.mean[:, None]], axis=1)
    return values, jnp.concatenate([estimate.valid, there[:, None]], axis=1)


_conditional = jax.jit(conditional, static_argnames=("bins", "pairs"))
_dimension = jax.jit(effective_dimension)


@jax.jit
def _routes(x: Array, y: Array, x_mask: Array, y_mask: Array) -> similarity.Similarity:
    def pair(sides: tuple[Array, ...]) -> similarity.Similarity:
        x, y, x_mask, y_mask = sides
        return similarity.between_lines(x, y, x_mask=x_mask, y_mask=y_mask)

    return jax.lax.map(pair, (x, y, x_mask, y_mask))


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


def _by_area(teams: Teams, evaluate: Callable[[Array, Array], tuple]) -> dict[str, np.ndarray]:
    """Divergence for the middle k, mean and root mean square distance in each area, [A, P]."""
    within = jax.vmap(lambda station: inside(teams.areas, station))(jnp.asarray(teams.station))
    rows = []
    for mask in jnp.moveaxis(within, 1, 0) & jnp.asarray(teams.valid)[None]:
        found, away, there = evaluate(jnp.asarray(teams.points), mask)
        middle = found.value.shape[1] // 2
        part = {"value": found.value[:, middle], "valid": found.valid[:, middle], "samples": mask.sum(1)}
        rows.append({**part, "mean": away.mean, "rmse": away.rmse, "near": there})
    return {name: np.stack([np.asarray(row[name]) for row in rows]) for name in rows[0]}
