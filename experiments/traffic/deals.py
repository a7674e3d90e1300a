"""Laps of two teams dealt out anew, in every way or in some, and what the divergences come to then."""

import itertools
import math
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from experiments.traffic.study import TrafficStudy
from experiments.traffic.teams import Teams
from urbanjax.traffic.divergence.conditional import conditional
from urbanjax.traffic.divergence.estimate import DivergenceParams, divergence
from urbanjax.traffic.divergence.neighbours import Pairs
from urbanjax.traffic.resampling import LapSwap, lap_swap
from urbanjax.types import ConfigError

FEWEST = 6  # ways to deal that tell something: two runs of each of two teams


def swapped(
    study: TrafficStudy, teams: Teams, params: DivergenceParams, arrays: tuple[Array, ...], bins: int, pairs: Pairs
) -> LapSwap:
    """Divergences and those given the station [P, 2 K], and what they are when laps are dealt out otherwise.

    Not valid where there are fewer than FEWEST ways to deal them out.
    Args: arrays, points, mask, offset and station bin of the teams.
    """
    runs = int(teams.runs.max())
    rng = np.random.default_rng(study.seed)
    found = []
    for i, j in pairs:
        counts = teams.runs[[i, j]]
        dealt = (_swaps if teams.paired else _deals)(int(counts[0]), int(counts[1]), study.teams.deals, rng)
        deals = np.zeros((len(dealt), 2 * runs), bool)
        deals[:, : counts[0]], deals[:, runs : runs + counts[1]] = dealt[:, : counts[0]], dealt[:, counts[0] :]
        run = np.concatenate([teams.run[i], teams.run[j] + runs])
        pooled = tuple(jnp.concatenate([a[i], a[j]]) for a in arrays)
        swap = jax.device_get(_deal(*pooled, jnp.asarray(run), jnp.asarray(deals), params, bins))
        ways = 2 ** int(counts[0]) if teams.paired else math.comb(int(counts.sum()), int(counts[0]))
        found.append(swap.replace(valid=swap.valid & (ways >= FEWEST)))
    least = min(len(swap.null) for swap in found)
    found = [swap.replace(null=swap.null[:least]) for swap in found]
    return jax.tree.map(lambda *leaves: np.stack(leaves), *found)


@partial(jax.jit, static_argnums=7)
def _deal(
    points: Array, valid: Array, offset: Array, station_bin: Array, run: Array, deals: Array, params: Any, bins: int
) -> LapSwap:
    def statistic(mask: Array) -> tuple[Array, Array]:
        one, key = ((0, 1),), jax.random.key(0)
        whole = divergence(jnp.stack([points, points]), mask, params=params, pairs=one, key=key)
        sides = jnp.stack([offset, offset]), jnp.stack([station_bin, station_bin])
        given = conditional(*sides, valid=mask, bins=bins, params=params, pairs=one, key=key)
        values, fine = (whole.value[0], given.value[0]), (whole.valid[0], given.valid[0])
        return jnp.concatenate(values), jnp.concatenate(fine)

    return lap_swap(statistic, run, valid=valid, deals=deals)


def _deals(first: int, second: int, most: int, rng: np.random.Generator) -> np.ndarray:
    """Which of first + second runs the first team gets [S, first + second], as they were driven first."""
    total = first + second
    every = itertools.combinations(range(total), first)
    listed = list(itertools.islice(every, most + 1))
    if len(listed) > most:  # too many to go through: as driven, and random ones
        listed = [tuple(range(first))] + [tuple(rng.permutation(total)[:first]) for _ in range(most - 1)]
    return np.array([[r in chosen for r in range(total)] for chosen in listed])


def _swaps(first: int, second: int, most: int, rng: np.random.Generator) -> np.ndarray:
    """The same where runs belong together in pairs: each pair is swapped or not. Raises ConfigError for single runs."""
    if first != second:
        raise ConfigError(f"'teams.paired': the teams have {first} and {second} runs; paired ones have equally many")
    if 2**first <= most:
        swapped = np.array(list(itertools.product((False, True), repeat=first)))
    else:
        swapped = rng.random((most, first)) < 0.5
        swapped[0] = False
    return np.concatenate([~swapped, swapped], axis=1)
