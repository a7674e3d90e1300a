"""How fast divergences are estimated and how much memory that takes, beside scipy's tree on the same points.

What is timed of cKDTree is all that the estimates need: a tree of each team, balanced or not (the better counts), the
queries on its threads and the means of the logarithms. The package `divergence` (extra `peers`) does so on one thread.
"""

import functools
import importlib
import os
import statistics
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial import cKDTree

from experiments.benchmark.divergence_points import KINDS
from experiments.common import timing
from urbanjax.traffic.divergence.estimate import DivergenceParams, all_pairs, divergence
from urbanjax.traffic.divergence.neighbours import Pairs
from urbanjax.types import SEED, ConfigError, as_arrays, pytree, static

PAIR: Pairs = ((0, 1),)
Tick = Callable[[str], None]


@pytree
class DivergenceSpeedStudy:
    """Sizes of the teams, for both kinds of points, and how often each call is timed."""

    k: int = static(default=5, metadata={"range": (1, 100)})
    sizes: tuple[int, ...] = static(default=(1000, 10_000, 82_137, 100_000, 1_000_000))  # of two teams; 82,137: paper
    teams: int = static(default=5, metadata={"range": (2, 100)})  # of which all ordered pairs are found in one call
    each: int = static(default=10_000)  # points of each of these
    package_most: int = static(default=10_000)  # points up to which the package `divergence` is timed too
    threads: int = static(default=2, metadata={"range": (1, 1000)})  # of cKDTree
    repeats: int = static(default=5)  # of each call, in turns
    most: int = static(default=1_000_000)  # points in all repeats; where that is one of them, the first call is timed
    seed: int = static(default=0, metadata=SEED)


def package() -> Any | None:
    """The package `divergence`, or None where it is not installed."""
    try:
        return importlib.import_module("divergence")
    except ImportError:
        return None


def by_trees(points: np.ndarray, pairs: Pairs, k: int, threads: int, balanced: bool = True) -> np.ndarray:
    """The corrected estimates [P] in nats from one cKDTree of each team. Args: points [T, n, d]."""
    trees = [cKDTree(team, balanced_tree=balanced) for team in points]
    n, d = points.shape[1:]
    own = {i: np.log(trees[i].query(points[i], [k + 1], workers=threads)[0]) for i in {i for i, _ in pairs}}
    other = (np.log(trees[j].query(points[i], [k], workers=threads)[0]) for i, j in pairs)
    return np.array([d * np.mean(s - own[i]) + np.log(n / (n - 1)) for (i, _), s in zip(pairs, other, strict=True)])


def measure(study: DivergenceSpeedStudy, tick: Tick = lambda label: None) -> dict[str, float]:
    """Differences from the peers in nats, medians in milliseconds, bytes per point: name with unit to value."""
    if min((study.each, *study.sizes)) <= study.k + 1:
        raise ConfigError(f"divergence: 'each' ({study.each}) and 'sizes' {study.sizes} must exceed k + 1")
    cases = {str(n): (2, n, PAIR) for n in study.sizes}
    cases[f"{study.teams}x{study.each}"] = (study.teams, study.each, all_pairs(study.teams))
    tick(f"divergence: {len(cases)} programs")
    params = as_arrays(DivergenceParams(ks=(study.k,)))
    with ThreadPoolExecutor(2) as pool:
        compiling, programs = timing.timed(
            lambda: list(pool.map(lambda case: _compiled(params, *case), cases.values()))
        )
    out = {"divergence_threads": float(len(os.sched_getaffinity(0))), "divergence_compile_s": compiling}
    for (name, (teams, n, pairs)), program in zip(cases.items(), programs, strict=True):
        tick(f"divergence: {name} points")
        memory = program.memory_analysis()
        if memory is not None:
            used = memory.temp_size_in_bytes + memory.output_size_in_bytes
            out[f"divergence_{name}_bytes_per_point"] = used / (teams * n)
        ours = functools.partial(_values, program, params)
        for kind, drawn in KINDS.items():
            points = drawn(teams, n, np.random.default_rng(study.seed))
            out.update(_beside(study, ours, points, pairs, f"{kind}_{name}"))
    return out


def _compiled(params: DivergenceParams, teams: int, n: int, pairs: Pairs) -> Any:
    points, valid = jax.ShapeDtypeStruct((teams, n, 2), jnp.float32), jax.ShapeDtypeStruct((teams, n), bool)
    return jax.jit(divergence, static_argnames="pairs").lower(points, valid, params=params, pairs=pairs).compile()


def _values(program: Any, params: DivergenceParams, points: jax.Array, valid: jax.Array) -> jax.Array:
    return program(points, valid, params=params).value[:, 0]


def _beside(
    study: DivergenceSpeedStudy, ours: Callable, points: np.ndarray, pairs: Pairs, name: str
) -> dict[str, float]:
    """Our numbers and the peers' on the same points [T, n, 2]."""
    n = points.shape[1]
    exact, trees = points.astype(float), functools.partial(by_trees, pairs=pairs, k=study.k, threads=study.threads)
    repeats = min(study.repeats, study.most // (n * len(pairs)))
    calls: dict[str, Callable[[], Any]] = {
        "divergence": functools.partial(ours, jnp.asarray(points), jnp.ones(points.shape[:2], bool)),
        "ckdtree": lambda: trees(exact),
    }
    if repeats > 1:
        calls["ckdtree_unbalanced"] = lambda: trees(exact, balanced=False)
    library = package() if pairs == PAIR and n <= study.package_most else None
    if library is not None:
        calls["package"] = lambda: np.array([library.knn_kl_divergence(*exact, k=study.k)])
    times, results = _in_turns(calls, repeats)
    out = {f"{who}_{name}_ms": 1e3 * seconds for who, seconds in times.items()}
    for who in list(calls)[1:]:
        out[f"{who}_{name}_difference_nats"] = float(np.abs(results[who] - results["divergence"]).max())
    best = min(seconds for who, seconds in times.items() if who.startswith("ckdtree"))
    out[f"divergence_{name}_times_faster"] = best / times["divergence"]
    out[f"divergence_{name}_first_nats"] = float(results["divergence"][0])
    return out


def _in_turns(calls: dict[str, Callable[[], Any]], repeats: int) -> tuple[dict[str, float], dict[str, np.ndarray]]:
    """Median of the warm seconds of each call, and its result; with fewer than two repeats of the first call alone."""
    firsts = {who: timing.timed(call) for who, call in calls.items()}
    again = repeats if repeats > 1 else 0
    samples: dict[str, list[float]] = {who: [] if again else [seconds] for who, (seconds, _) in firsts.items()}
    for _ in range(again):
        for who, call in calls.items():
            samples[who].append(timing.seconds(call))
    results = {who: np.asarray(result) for who, (_, result) in firsts.items()}
    return {who: statistics.median(values) for who, values in samples.items()}, results


def table(numbers: dict[str, float]) -> dict[str, list[Any]]:
    """Columns by heading for people; of cKDTree the better tree, None for what was not measured."""
    cases = [key.removeprefix("divergence_").removesuffix("_times_faster") for key in numbers]
    cases = [case for case in cases if f"divergence_{case}_first_nats" in numbers]
    trees = [
        min(
            numbers[f"{tree}_{case}_ms"] for tree in ("ckdtree", "ckdtree_unbalanced") if f"{tree}_{case}_ms" in numbers
        )
        for case in cases
    ]
    differences = [
        max(value for key, value in numbers.items() if key.endswith(f"_{case}_difference_nats")) for case in cases
    ]
    return {
        "points": [case.replace("_", " ").replace("x", " teams x ") for case in cases],
        "ours [ms]": [numbers[f"divergence_{case}_ms"] for case in cases],
        "cKDTree [ms]": trees,
        "faster": [numbers[f"divergence_{case}_times_faster"] for case in cases],
        "package [ms]": [numbers.get(f"package_{case}_ms") for case in cases],
        "apart [nats]": differences,
        "bytes/point": [numbers.get(f"divergence_{case.split('_')[1]}_bytes_per_point") for case in cases],
    }
