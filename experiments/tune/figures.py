"""What a search did, and where it made a difference."""

from pathlib import Path
from typing import Any

import numpy as np

from experiments.tune.search import Searched
from experiments.tune.tested import HeldBackDrives
from urbanjax.io.figures.style import BAD, GOOD, OTHER, figure

MOST = 12  # numbers whose way is drawn, those that moved farthest


def costs(found: Searched) -> np.ndarray:
    """What was spent up to the end of every epoch [E], in losses as deployed of one generation's scenes."""
    spent = [found.multiple * epoch.evaluations for epoch in found.epochs]
    return np.array(spent)


def draw_convergence(found: Searched, path: Path) -> None:
    """Scores over seconds and over what they cost in drives without gradient. Args: found; path of the picture."""
    shown = {"judged by, as deployed": ("validation", GOOD, "o-"), "learned from, relaxed": ("loss", OTHER, "-")}
    axis = {"time [s], compiling included": np.cumsum(found.seconds), "cost [forward evaluations]": costs(found)}
    horizon = np.array([epoch.horizon for epoch in found.epochs])
    with figure(path, 9.0, height=4.4) as canvas:
        panels = canvas.subplots(2, 2, sharey="row", sharex="col")
        for row, (label, (name, colour, line)) in zip(panels, shown.items(), strict=True):
            values = np.array([np.nan if (x := getattr(e, name)) is None else -x for e in found.epochs])
            there = np.isfinite(values)
            for axes, x in zip(row, axis.values(), strict=True):
                axes.plot(x[there], values[there], line, color=colour, ms=4, lw=1.2)
                for k in np.flatnonzero(np.diff(horizon)) + 1:
                    axes.axvline(x[k], color=BAD, lw=0.8, ls=":")
            row[0].set(ylabel="score", title=f"Scenes {label}")
        for axes, label in zip(panels[-1], axis, strict=True):
            axes.set(xlabel=label, xlim=(0, None))


def draw_values(found: Searched, path: Path) -> None:
    """The numbers that moved farthest, relative to where they began. Args: found; path of the picture."""
    search = found.search
    z = search.optimiser.history()["z"].reshape(-1, search.space.size)
    points = len(search.optimiser.standing())
    z = z[:: max(points, 1)]
    moved = np.argsort(-np.abs(z[-1]))[:MOST]
    with figure(path, 8.0, height=4.0) as canvas:
        axes = canvas.subplots()
        from matplotlib import colormaps

        for shade, k in zip(np.linspace(0, 1, max(len(moved), 1)), moved, strict=False):
            key = search.space.keys[k].removeprefix("stack.")
            axes.plot(z[:, k], color=colormaps["turbo"](0.05 + 0.9 * shade), label=key, lw=1.3)
        axes.axhline(0, color=OTHER, lw=0.8)
        axes.set(
            xlabel="generation", ylabel="z [-]: log of the factor, for weights", title="The numbers that moved farthest"
        )
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=7)


def draw_differences(found: HeldBackDrives, name: str, path: Path) -> None:
    """The score of every drive before and after, and of each mission. Args: found; name, of the set; path."""
    first = found.names[0]
    before, after = (np.array([row["score"] for row in found.rows[one]]) for one in (first, name))
    missions = np.array([row["mission"] for row in found.rows[first]])
    with figure(path, 9.0, height=3.6) as canvas:
        left, right = canvas.subplots(1, 2, gridspec_kw={"width_ratios": [1, 1.3]})
        low = float(np.quantile(np.concatenate([before, after]), 0.02))
        high = float(max(before.max(), after.max()))
        left.plot([low, high], [low, high], color=OTHER, lw=0.8)
        left.scatter(before, after, s=6, color=GOOD, alpha=0.5, linewidths=0)
        left.set(
            xlabel=f"score, {first}",
            ylabel=f"score, {name}",
            xlim=(low, high),
            ylim=(low, high),
            title="Drive by drive",
        )
        names = list(dict.fromkeys(missions))
        gains = [(after - before)[missions == mission] for mission in names]
        right.boxplot(gains, orientation="horizontal", showfliers=False, medianprops={"color": GOOD})
        right.axvline(0, color=BAD, lw=0.8)
        right.set(
            yticks=range(1, len(names) + 1), yticklabels=[n.replace("_", " ") for n in names], xlabel="gain in score"
        )
        right.set(title="By mission (box: half of the drives)")


def draw_before_after(logs: list[tuple[str, Any, Any]], path: Path) -> None:
    """Speed, acceleration and offset over time in some drives, before and after. Args: logs, (title, log, log)."""
    with figure(path, 9.0, height=1.9 * max(len(logs), 1)) as canvas:
        grid = canvas.subplots(len(logs), 3, squeeze=False, sharex=False)
        for axes, (title, before, after) in zip(grid, logs, strict=True):
            for log, colour, label in ((before, OTHER, "before"), (after, GOOD, "after")):
                time = log.time - log.time[0]
                axes[0].plot(time, log.ego.speed, color=colour, label=label)
                axes[1].plot(time, log.ego.acceleration, color=colour)
                axes[2].plot(time, log.offset, color=colour)
            axes[0].set_title(title, fontsize=8)
            axes[0].set(ylabel="speed [m/s]")
            axes[1].set(ylabel="acceleration [m/s²]")
            axes[2].set(ylabel="offset from lane [m]")
        grid[0, 0].legend()
        for panel in grid[-1]:
            panel.set(xlabel="time [s]")
