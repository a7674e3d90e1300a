"""Teams on one course as pictures: matrices, where routes coincide, distributions, and the null of dealt-out laps."""

from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jax import Array

from experiments.traffic.compare import Comparison
from experiments.traffic.teams import Teams
from urbanjax.io.figures.style import BAD, LINE, OTHER, figure
from urbanjax.traffic.course.line import Profile, profile

PROFILE_BINS = 200


@partial(jax.jit, static_argnames="bins")
def _profiles(station: Array, offset: Array, mask: Array, length: float | Array, bins: int) -> Profile:
    each = jax.vmap(lambda s, d, m: profile(s, d, mask=m, length=length, bins=bins))
    return each(station, offset, mask)


def colours(count: int) -> list[Any]:
    """A colour per team."""
    import matplotlib

    scale = matplotlib.colormaps["tab10" if count <= 10 else "tab20"]
    return [scale(i % scale.N) for i in range(count)]


def draw_matrices(teams: Teams, found: Comparison, path: Path) -> None:
    """Divergence, its excess over dealt-out laps (whole and given the station), and distance, of all ordered pairs."""
    c, last, n = found.middle, len(found.ks), len(teams.names)
    panels = [
        ("a  divergence [nats]", found.estimate.value[:, c], found.estimate.valid[:, c]),
        ("b  excess over laps dealt out anew", found.swap.excess[:, c], found.swap.valid[:, c]),
        ("c  the same given the station", found.swap.excess[:, last + c], found.swap.valid[:, last + c]),
        ("d  mean distance [m]", found.samples.mean, np.ones(len(found.pairs), bool)),
    ]
    size = 0.42 * n + 1.0
    with figure(path, 4 * size + 0.4, height=size + 0.5) as canvas:
        for axes, (title, values, valid) in zip(canvas.subplots(1, 4), panels, strict=True):
            grid = np.full((n, n), np.nan)
            for (i, j), value, good in zip(found.pairs, values, valid, strict=True):
                grid[i, j] = value if good else np.nan
            reach = max(float(np.nanmax(np.abs(grid))) if np.isfinite(grid).any() else 0.0, 1e-6)
            low = -reach if np.nanmin(np.append(grid, 0)) < 0 else 0.0
            axes.imshow(grid, cmap="RdBu_r" if low < 0 else "Reds", vmin=low, vmax=reach)
            for i, j in found.pairs:
                if np.isfinite(grid[i, j]):
                    dark = abs(grid[i, j]) > 0.6 * reach
                    axes.text(
                        j, i, f"{grid[i, j]:.2f}", ha="center", va="center", fontsize=6.5, color="w" if dark else "k"
                    )
            axes.set_xticks(range(n), teams.names, rotation=60, ha="right", fontsize=7)
            axes.set_yticks(range(n), teams.names, fontsize=7)
            axes.set_title(title)
            axes.grid(False)


def draw_routes(teams: Teams, path: Path) -> None:
    """Where routes coincide: the course by the spread of the teams' mean offsets, and those offsets by station."""
    from matplotlib.collections import LineCollection

    found = _profiles(teams.station, teams.offset, teams.valid, teams.length, bins=PROFILE_BINS)
    mean = np.where(found.count > 0, found.mean, np.nan)
    known = np.isfinite(mean).sum(0) > 1
    spread = np.full(PROFILE_BINS, np.nan)
    spread[known] = np.nanstd(mean[:, known], axis=0)
    station = np.asarray(found.station[0])
    line = np.concatenate([teams.line, teams.line[:1]]) if teams.closed else teams.line
    along = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    at = np.stack([np.interp(np.linspace(0, along[-1], PROFILE_BINS + 1), along, axis) for axis in line.T], 1)
    with figure(path, 11.0, height=4.6) as canvas:
        left, right = canvas.subplots(1, 2, width_ratios=(1, 1.4))
        parts = LineCollection(list(np.stack([at[:-1], at[1:]], 1)), array=spread, cmap="viridis_r", lw=5)
        left.add_collection(parts)
        left.set(title="a  spread of the teams' mean offsets", xlabel="x [m]", ylabel="y [m]")
        left.autoscale()
        left.set_aspect("equal", "datalim")
        canvas.colorbar(parts, ax=left, label="standard deviation [m]", shrink=0.8)
        _shade(right, teams)
        for name, values, colour in zip(teams.names, mean, colours(len(teams.names)), strict=True):
            right.plot(station, values, color=colour, lw=1.1, label=name)
        right.set(title="b  mean offset from the reference line", xlabel="station [m]", ylabel="left [m]")
        right.legend(ncols=4, loc="best", fontsize=7)


def _shade(axes: Any, teams: Teams) -> None:
    """Curves as grey bands."""
    for name, start, end in zip(
        teams.areas.names, np.asarray(teams.areas.start), np.asarray(teams.areas.end), strict=True
    ):
        if name.startswith("straight"):
            continue
        for a, b in [(start, end)] if start < end else [(start, teams.length), (0.0, end)]:
            axes.axvspan(a, b, color="#f0f0f0", lw=0)


def draw_distributions(teams: Teams, path: Path) -> None:
    """Distributions of lateral offset, speed and time of a run, team by team."""
    panels = [("a  offset [m]", teams.offset), ("b  speed [m/s]", teams.speed)]
    with figure(path, 11.0, height=3.6) as canvas:
        *two, last = canvas.subplots(1, 3)
        for axes, (title, values) in zip(two, panels, strict=True):
            shown = np.concatenate([v[m] for v, m in zip(values, teams.valid, strict=True)])
            low, high = np.quantile(shown, [0.002, 0.998])
            edges = np.linspace(low, high if high > low else low + 1, 61)
            for name, v, m, colour in zip(teams.names, values, teams.valid, colours(len(teams.names)), strict=True):
                axes.hist(v[m], edges, density=True, histtype="step", color=colour, label=name, lw=1.2)
            axes.set(title=title, ylabel="density")
        two[0].legend(fontsize=7)
        for t, (times, colour) in enumerate(zip(teams.lap_times, colours(len(teams.names)), strict=True)):
            last.plot(np.full(len(times), t), times, "o", color=colour, ms=4)
        last.set_xticks(range(len(teams.names)), teams.names, rotation=60, ha="right", fontsize=7)
        last.set(title="c  time of a run [s]")


def draw_null(teams: Teams, found: Comparison, path: Path) -> None:
    """How far each pair is above the mean of all deals of its laps, beside the others: whole and given the station."""
    c, last = found.middle, len(found.ks)
    labels = [f"{teams.names[i]} | {teams.names[j]}" for i, j in found.pairs]
    where = np.arange(len(labels))
    with figure(path, 9.5, height=0.17 * len(labels) + 1.4) as canvas:
        left, right = canvas.subplots(1, 2, sharey=True)
        panels = (left, c, "a  divergence less the mean of all deals [nats]"), (right, last + c, "b  given the station")
        for axes, k, title in panels:
            middle = (found.swap.observed - found.swap.excess)[:, k]
            null = found.swap.null[..., k] - middle[:, None]
            axes.plot(
                null.ravel(), np.repeat(where, null.shape[1]), "|", color=OTHER, ms=5, alpha=0.6, label="dealt out"
            )
            axes.plot(found.swap.excess[:, k], where, "o", color=BAD, ms=3.5, label="as driven")
            axes.axvline(0, color=LINE, lw=0.8)
            axes.set(title=title)
        left.set_yticks(where, labels, fontsize=6)
        left.set_ylim(len(labels) - 0.5, -0.5)
        right.legend(loc="lower right")
