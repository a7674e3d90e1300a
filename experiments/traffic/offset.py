"""What the size of Table III says: divergences between teams on one lap, as all are sampled ever more densely."""

from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from experiments.traffic.study import OffsetStudy
from urbanjax.io.figures.style import LINE, OTHER, figure, shades
from urbanjax.traffic.divergence.estimate import DivergenceParams, divergence
from urbanjax.traffic.divergence.neighbours import distances, neighbours
from urbanjax.types import ConfigError, as_arrays, host_record

NAMES = "ABCDEFGHIJKLMNOPQRST"


@host_record
class Sweep:
    """Over S spacings, K values of k, T teams of which the first is offset."""

    spacings: np.ndarray  # [S] m
    ks: tuple[int, ...]
    value: np.ndarray  # [S, K, T, T] nats, 0 on the diagonal
    radius: np.ndarray  # [S, K, T] m, geometric mean distance to the k-th own neighbour
    gap: np.ndarray  # [S, K, T, T] m, geometric mean distance to the k-th neighbour of the other
    offset: float  # m


def sweep(study: OffsetStudy, seed: int) -> Sweep:
    """The study at every spacing. Raises ConfigError where a lap has too few samples."""
    coarsest = float(study.length) / max(float(spacing) for spacing in study.spacings)
    if coarsest < 4 * max(study.ks):
        raise ConfigError(
            f"'offset.spacings': a lap of {float(study.length):g} m has {coarsest:.0f} samples at the largest, fewer "
            f"than 4 k = {4 * max(study.ks)}: set a smaller one or a longer 'offset.length'"
        )
    rng = np.random.default_rng(seed)
    waves = rng.normal(size=(study.teams, 6, 2))
    pairs = tuple((i, j) for i in range(study.teams) for j in range(study.teams))
    values, radii, gaps = [], [], []
    for spacing in study.spacings:
        points = jnp.asarray(_laps(study, float(spacing), waves, rng), jnp.float32)
        value, away = _estimates(points, as_arrays(DivergenceParams(ks=study.ks, ties="floor", size=1e-9)), pairs)
        square = np.asarray(away).reshape(study.teams, study.teams, len(study.ks))
        values.append(np.moveaxis(np.asarray(value).reshape(square.shape), -1, 0))
        radii.append(np.stack([square[i, i] for i in range(study.teams)], axis=-1))
        gaps.append(np.moveaxis(square, -1, 0))
    spacings = np.array(study.spacings, float)
    return Sweep(spacings, study.ks, np.stack(values), np.stack(radii), np.stack(gaps), float(study.offset))


@partial(jax.jit, static_argnums=2)
def _estimates(points: jax.Array, params: DivergenceParams, pairs: tuple) -> tuple[jax.Array, jax.Array]:
    """Divergences and geometric mean distances of all pairs [P, K]."""
    valid = jnp.ones(points.shape[:2], bool)
    value = jnp.zeros((len(pairs), len(params.ks)), points.dtype)
    different = tuple(pair for pair in pairs if pair[0] != pair[1])
    found = divergence(points, valid, params=params, pairs=different)
    value = value.at[jnp.asarray([pairs.index(pair) for pair in different])].set(found.value)
    away, there = distances(points, pairs, index=neighbours(points, valid, pairs=pairs, ranks=params.ks))
    logs = jnp.log(jnp.where(there & (away > 0), away, 1))
    return value, jnp.exp(jnp.sum(logs, axis=-1) / jnp.sum(there & (away > 0), axis=-1))


def _laps(study: OffsetStudy, spacing: float, waves: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """One lap of each team [T, n, 2], m: an oval driven with smooth deviations, the first team's frame shifted."""
    count = round(float(study.length) / spacing)
    angle = 2 * np.pi * (np.arange(count)[None] + rng.uniform(0, 1, (study.teams, 1))) / count
    order = np.arange(3, 9)[None, :, None]
    smooth = (waves[..., :1] * np.cos(order * angle[:, None]) + waves[..., 1:] * np.sin(order * angle[:, None])).sum(1)
    radius = float(study.length) / (2 * np.pi) + float(study.apart) * smooth / np.sqrt(6)
    laps = radius[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    laps[0] += [float(study.offset), 0.0]
    return laps


def table(found: Sweep) -> dict[str, list[Any]]:
    """One row per spacing and k: the offset team, the others, and d log(offset / r)."""
    rows: dict[str, list[Any]] = {}
    others = _others(found)
    for s, spacing in enumerate(found.spacings):
        for c, k in enumerate(found.ks):
            radius = float(np.exp(np.log(found.radius[s, c]).mean()))
            row = {
                "spacing [m]": float(spacing),
                "k": k,
                "offset team, mean [nats]": float(found.value[s, c, 0, 1:].mean()),
                "2 log(offset / 2 r) [nats]": float(2 * np.log(found.offset / 2 / radius)),
                "2 log(s / r) [nats]": float(2 * np.log(found.gap[s, c, 0, 1:] / found.radius[s, c, 0]).mean()),
                "other teams, mean [nats]": float(others[s, c].mean()),
                "other teams, largest [nats]": float(others[s, c].max()),
                "r [m]": radius,
            }
            for name, value in row.items():
                rows.setdefault(name, []).append(value)
    return rows


def _others(found: Sweep) -> np.ndarray:
    """Divergences among the teams that agree [S, K, pairs]."""
    teams = found.value.shape[-1]
    return np.stack([found.value[..., i, j] for i in range(1, teams) for j in range(1, teams) if i != j], axis=-1)


def matrix(found: Sweep, spacing: float, k: int) -> dict[str, list[Any]]:
    """The matrix like Table III at the spacing nearest to one given, rows P, columns Q."""
    s, c = int(np.abs(np.log(found.spacings / spacing)).argmin()), found.ks.index(k)
    grid = found.value[s, c]
    names = [f"{NAMES[t]}{' (offset)' if t == 0 else ''}" for t in range(len(grid))]
    rows: dict[str, list[Any]] = {"P \\ Q": list(names)}
    for j, name in enumerate(names):
        rows[name] = [None if i == j else float(grid[i, j]) for i in range(len(grid))]
    return rows


def summary(found: Sweep) -> dict[str, float]:
    """Flat numbers by name."""
    numbers = {}
    for s, spacing in enumerate(found.spacings):
        for c, k in enumerate(found.ks):
            numbers[f"offset_team_k{k}_at_{spacing:g}m_nats"] = float(found.value[s, c, 0, 1:].mean())
            numbers[f"other_teams_k{k}_at_{spacing:g}m_nats"] = float(_others(found)[s, c].mean())
    return numbers


def draw(found: Sweep, path: Path) -> None:
    """Divergences over the sample spacing, with d log(offset / r), and the matrix at two spacings.

    On a closed lap the offset lies beside the road by the cosine of its angle to it only, whose logarithm is -log 2 on
    average.
    """
    with figure(path, 11.0, height=4.0) as canvas:
        left, *grids = canvas.subplots(1, 3, width_ratios=(1.5, 1, 1))
        others, colours = _others(found), shades(len(found.ks) + 1)
        for c, (k, colour) in enumerate(zip(found.ks, colours, strict=False)):
            radius = np.exp(np.log(found.radius[:, c]).mean(-1))
            left.plot(
                found.spacings, found.value[:, c, 0, 1:].mean(-1), "o", color=colour, label=f"offset team, k = {k}"
            )
            left.plot(
                found.spacings, 2 * np.log(found.offset / 2 / radius), color=colour, lw=1, label="2 log(offset / 2 r)"
            )
            left.plot(
                found.spacings, others[:, c].mean(-1), "s", color=colour, mfc="none", label=f"other teams, k = {k}"
            )
        left.axhspan(13.3, 14.3, color="#f0f0f0", lw=0)
        left.text(
            found.spacings.max(), 13.8, "KAIST's row of Table III", ha="left", va="center", fontsize=7, color=OTHER
        )
        left.axhline(0, color=LINE, lw=0.8)
        left.set(xscale="log", xlabel="sample spacing [m]", title=f"a  divergence [nats], offset {found.offset:g} m")
        left.invert_xaxis()
        left.legend(fontsize=7, loc="upper left", bbox_to_anchor=(0.0, 0.84))
        for axes, s, letter in zip(grids, (0, len(found.spacings) - 1), "bc", strict=True):
            grid = found.value[s, 0].copy()
            np.fill_diagonal(grid, np.nan)
            reach = float(np.nanmax(np.abs(grid)))
            axes.imshow(grid, cmap="RdBu_r", vmin=-reach, vmax=reach)
            for i, j in zip(*np.nonzero(np.isfinite(grid)), strict=True):
                dark = abs(grid[i, j]) > 0.6 * reach
                axes.text(j, i, f"{grid[i, j]:.1f}", ha="center", va="center", fontsize=7, color="w" if dark else "k")
            ticks = [NAMES[t] for t in range(len(grid))]
            axes.set_xticks(range(len(grid)), ticks)
            axes.set_yticks(range(len(grid)), ticks)
            axes.set_title(f"{letter}  at {found.spacings[s]:g} m, k = {found.ks[0]}")
            axes.grid(False)
