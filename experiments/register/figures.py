"""The figures of the study of registration."""

from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from experiments.common.lost import lost_after
from experiments.register.bench import Setting
from experiments.register.calibration import DEGREES, Calibration
from experiments.register.factorial import THRESHOLDS, Grid
from experiments.register.rows import PAPER, STARTS, RowTrack
from urbanjax.io.figures.style import BAD, GOOD, LINE, OTHER, figure

COLOURS = {"ndt": BAD, "vgicp": GOOD}
STAGES = (("pre-processing", "#9db4c0"), ("window", "#d98e04"), ("registration", "#2a7f62"))
SPEEDS = 6  # bins


def draw_rows(
    tracks: dict[tuple[Setting, str], RowTrack], speed: np.ndarray, period: float, limit: float, path: Path
) -> None:
    """Error along the drive for each different row from both starts, and the time per scan by stage.

    Args: speed [T] m/s, of the drive.
    """
    settings = list(dict.fromkeys(row.setting for row in PAPER))
    numbers = {s: [k + 1 for k, row in enumerate(PAPER) if row.setting == s] for s in settings}
    labels = {s: f"{min(n)}" if len(n) == 1 else f"{min(n)}-{max(n)}" for s, n in numbers.items()}
    styles = dict(zip(settings, _styles(settings), strict=True))
    with figure(path, 10.5, height=7.0) as canvas:
        grid = canvas.add_gridspec(2, 2, width_ratios=(2.2, 1.0))
        for i, (start, words) in enumerate(STARTS.items()):
            axes = canvas.add_subplot(grid[i, 0])
            axes.set_xlabel("time [s]" if i else "")
            for s in settings:
                distance = tracks[s, start].distance
                time = period * np.arange(1, len(distance) + 1)
                axes.semilogy(time, np.maximum(distance, 1e-4), lw=1.1, label=f"row {labels[s]}", **styles[s])
                since = lost_after(distance, limit)
                if since is not None:
                    axes.plot(time[since], distance[since], "x", color=styles[s]["color"], ms=7, mew=2)
            axes.axhline(limit, color="black", lw=0.8, ls="--")
            axes.set(title=f"Planar error, each registration started from: {words}", ylabel="m", ylim=(5e-4, 20))
            axes.set_xlim(0, period * len(speed))
            beside = axes.twinx()
            beside.fill_between(period * np.arange(len(speed)), 3.6 * speed, color=LINE, alpha=0.15, lw=0)
            beside.set(ylabel="speed [km/h]", ylim=(0, 200))
            beside.grid(visible=False)
            axes.legend(ncols=6, loc="upper center", columnspacing=1.0)
        _bars(canvas.add_subplot(grid[:, 1]), tracks, settings, labels, period)


def _styles(settings: list[Setting]) -> list[dict[str, Any]]:
    made, seen = [], {"ndt": 0, "vgicp": 0}
    shades = {"ndt": ("#5b1a12", "#c0392b", "#e67e22", "#f0b27a"), "vgicp": ("#7fb3d5", "#2a7f62", "#145a32")}
    for s in settings:
        made.append({"color": shades[s.method][seen[s.method] % 4 if s.method == "ndt" else seen[s.method] % 3]})
        seen[s.method] += 1
    return made


def _bars(axes: Any, tracks: dict, settings: list[Setting], labels: dict[Setting, str], period: float) -> None:
    names = []
    for k, (s, start) in enumerate((s, start) for s in settings for start in STARTS):
        left = 0.0
        for stage, (_, colour) in enumerate(STAGES):
            took = float(np.median(tracks[s, start].milliseconds[:, stage]))
            axes.barh(k, took, left=left, color=colour, height=0.7)
            left += took
        names.append(f"row {labels[s]}, {STARTS[start]}")
    for name, colour in STAGES:
        axes.barh(0, 0, color=colour, label=name)
    axes.axvline(1e3 * period, color="black", lw=0.8, ls="--")
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.grid(axis="y", visible=False)
    axes.set(title="Time per scan (medians)", xlabel="ms")
    axes.legend(loc="upper center", bbox_to_anchor=(0.4, -0.06), ncols=3, columnspacing=1.0)


def draw_effects(grid: Grid, limit: float, period: float, path: Path) -> None:
    """Success and time against each axis, over all others, one line per method."""
    others = [name for name in grid.axes if name != "method"]
    with figure(path, 11.0, height=5.2) as canvas:
        axes = canvas.subplots(2, len(others) + 1, sharex="col", sharey="row")
        for m, method in enumerate(grid.axes["method"]):
            style = {"color": COLOURS[method], "ms": 4, "label": method}
            for column, name in enumerate(others):
                levels = grid.axes[name]
                good, took = (
                    np.moveaxis(x[m], others.index(name), 0).reshape(len(levels), -1)
                    for x in (grid.distance <= limit, grid.total)
                )
                _line(axes[:, column], np.arange(len(levels)), good, took, style)
                axes[1, column].set_xticks(np.arange(len(levels)), [f"{x:g}" for x in levels])
                axes[1, column].set_xlabel(name)
            edges = np.linspace(0, grid.speed.max() * 1.001, SPEEDS + 1)
            which = np.digitize(grid.speed, edges) - 1
            held = [k for k in range(SPEEDS) if (which == k).any()]
            good, took = ([x[m][..., which == k].ravel() for k in held] for x in (grid.distance <= limit, grid.total))
            _line(axes[:, -1], 3.6 * (edges[:-1] + edges[1:])[held] / 2, good, took, style)
        axes[1, -1].set_xlabel("speed of the start [km/h]")
        for axis in axes[0]:
            axis.tick_params(labelbottom=False)
        axes[0, 0].set(ylabel="%", ylim=(-3, 105))
        axes[0, 0].set_title(f"Success (error below {limit:g} m, 95 % intervals)")
        axes[1, 0].set(ylabel="ms", ylim=(0, None))
        axes[1, 0].set_title("Time per scan (median, quartiles)")
        for axis in axes[1]:
            axis.axhline(1e3 * period, color="black", lw=0.8, ls="--")
        axes[0, 0].legend(loc="center left")


def _line(axes: Any, x: np.ndarray, good: Any, took: Any, style: dict[str, Any]) -> None:
    share = np.array([row.mean() for row in good])
    ends = np.array([stats.binomtest(int(row.sum()), len(row)).proportion_ci(method="wilson") for row in good])
    away = 100 * np.abs(np.stack([share - ends[:, 0], ends[:, 1] - share]))
    axes[0].errorbar(x, 100 * share, away, fmt="o-", capsize=2, **style)
    quartiles = np.array([np.percentile(row, (25, 50, 75)) for row in took])
    axes[1].fill_between(x, quartiles[:, 0], quartiles[:, 2], color=style["color"], alpha=0.15, lw=0)
    axes[1].plot(x, quartiles[:, 1], "o-", **style)


def draw_cells(grid: Grid, limit: float, path: Path) -> None:
    """Every cell: share of successes and median time."""
    names = list(grid.axes)
    down, across = names[:3], names[3:]
    n_down = int(np.prod([len(grid.axes[n]) for n in down]))
    shown = (
        (100 * (grid.distance <= limit).mean(-1), "Success [%]", "BuGn", (0, 160)),
        (
            np.median(grid.total, -1),
            "Time per scan, median [ms]",
            "OrRd",
            (0, 1.6 * float(np.median(grid.total, -1).max())),
        ),
    )
    with figure(path, 12.5, height=1.6 + 0.34 * n_down) as canvas:
        for axes, (values, title, colours, (low, high)) in zip(canvas.subplots(1, 2), shown, strict=True):
            flat = values.reshape(n_down, -1)
            axes.imshow(flat, cmap=colours, vmin=low, vmax=high, aspect="auto")
            for i, j in np.ndindex(flat.shape):
                axes.text(j, i, f"{flat[i, j]:.0f}", ha="center", va="center", fontsize=7)
            axes.set_yticks(range(n_down), _labels(grid, down, "  "))
            axes.set_xticks(range(flat.shape[1]), _labels(grid, across, "\n"), fontsize=7)
            axes.set(title=title, xlabel=", ".join(across) + " (top to bottom)", ylabel=", ".join(down))
            axes.grid(visible=False)


def _labels(grid: Grid, names: list[str], between: str) -> list[str]:
    sizes = [len(grid.axes[name]) for name in names]
    return [
        between.join(
            str(grid.axes[n][i]) if isinstance(grid.axes[n][i], str) else f"{grid.axes[n][i]:g}"
            for n, i in zip(names, at, strict=True)
        )
        for at in np.ndindex(*sizes)
    ]


def draw_thresholds(grid: Grid, limit: float, path: Path) -> None:
    """Matching errors of right and wrong registrations by method and voxel, with the paper's thresholds."""
    methods, voxels = grid.axes["method"], grid.axes["voxel [m]"]
    bins = np.linspace(0, 1.0, 61)
    with figure(path, 10.0, height=2.2 * len(methods) + 0.4) as canvas:
        axes = canvas.subplots(len(methods), len(voxels), sharex=True, squeeze=False)
        for (m, v), axis in np.ndenumerate(axes):
            wrong = (grid.distance[m, v] > limit).ravel()
            error = grid.matching_error[m, v].ravel()
            for who, colour, name in ((~wrong, GOOD, "right"), (wrong, BAD, "wrong")):
                axis.hist(np.minimum(error[who], 0.999), bins, color=colour, alpha=0.6, label=f"{name}: {who.sum()}")
            for value in THRESHOLDS:
                axis.axvline(
                    value, color="black", lw=0.9, ls="--", label="the paper's" if value == THRESHOLDS[0] else None
                )
            axis.axvline(FLAT * voxels[v], color=OTHER, lw=0.9, ls=":", label="even square")
            axis.set(title=f"{methods[m]}, voxels of {voxels[v]:g} m", ylabel="registrations")
            axis.legend()
        for axis in axes[-1]:
            axis.set_xlabel("matching error [m]")


FLAT = 0.3826  # mean distance from the middle of a square of edge 1 of points spread evenly over it


def draw_calibration(found: Calibration, path: Path) -> None:
    """Normalised squared errors of the test set against chi^2, and coverage against its nominal value."""
    chi = stats.chi2(DEGREES)
    nees = found.test.nees / found.scale
    with figure(path, 10.5, height=3.4) as canvas:
        left, middle, right = canvas.subplots(1, 3)
        edges = np.linspace(0, 16, 41)
        left.hist(np.minimum(nees, 15.99), edges, density=True, color=GOOD, alpha=0.6, label=f"{len(nees)} test errors")
        x = np.linspace(1e-3, 16, 400)
        left.plot(x, chi.pdf(x), color="black", label=rf"$\chi^2$, {DEGREES} degrees")
        left.axvline(chi.ppf(found.level), color=OTHER, lw=0.9, ls="--", label=f"{100 * found.level:g} % ellipsoid")
        left.set(title=rf"NEES with $s^2$ = {found.scale:.3g}", xlabel="normalised squared error", ylabel="density")
        left.legend()
        levels = np.linspace(0.02, 0.995, 60)
        middle.plot(
            100 * levels, [100 * found.coverage(p) for p in levels], color=GOOD, label=rf"$s^2$ = {found.scale:.3g}"
        )
        middle.plot(100 * levels, [100 * found.coverage(p, 1.0) for p in levels], color=BAD, label=r"$s^2$ = 1")
        middle.plot([0, 100], [0, 100], color="black", lw=0.8, ls="--")
        middle.set(title="Coverage of the test errors", xlabel="nominal [%]", ylabel="inside [%]")
        middle.legend()
        kept = found.test.converged
        variance = found.scale * np.diagonal(found.test.covariance[kept], axis1=1, axis2=2)
        share = found.test.twist[kept] / np.sqrt(variance)
        for k, (name, colour) in enumerate((("longitudinal", "#2e86c1"), ("lateral", GOOD), ("heading", "#d98e04"))):
            right.hist(share[:, k], np.linspace(-4, 4, 41), density=True, histtype="step", color=colour, label=name)
        z = np.linspace(-4, 4, 200)
        right.plot(z, stats.norm.pdf(z), color="black", lw=0.9)
        right.set(title="Each error over its standard deviation", xlabel="ratio")
        right.legend()
