"""The figures of the overtaking study."""

from pathlib import Path
from typing import Any

import numpy as np

from experiments.common.overtaking import Fig10
from urbanjax.io.bridges.highway.renderer import Renderer
from urbanjax.io.figures.animation import stacked
from urbanjax.io.figures.style import BAD, GOOD, LINE, OTHER, ROAD, figure, shades
from urbanjax.roadmap.graph import RoadGraph
from urbanjax.sim.scenarios.overtake import LEADER

VARIANTS = ((GOOD, "o-", "with TTC clamp"), (BAD, "o--", "without"))


def exemplar(study: Fig10) -> int:
    """The start to look at: with a free lane and the speed drop at tau = 0 nearest to the mean of those."""
    free = ~study.crowded if (~study.crowded).any() else study.crowded
    drop = np.where(free, study.drop[0, 0], np.inf)
    return int(np.argmin(np.abs(drop - drop[free].mean())))


def draw_fig10(study: Fig10, path: Path, start: int) -> None:
    """The paper's three panels for one start: driven trajectories, speed and progress over time."""
    colours = shades(len(study.taus))
    with figure(path, 10.0, height=5.2) as canvas:
        grid = canvas.add_gridspec(2, 2, width_ratios=(1.25, 1.0))
        left, top, bottom = (canvas.add_subplot(place) for place in (grid[:, 0], grid[0, 1], grid[1, 1]))
        _trajectories(left, study, start, colours)
        for i, tau in enumerate(study.taus):
            top.plot(study.time, study.speed[i, 0, start], color=colours[i], label=rf"$\tau$ = {tau:g}")
            bottom.plot(study.time, study.way[i, 0, start], color=colours[i])
        top.set(title="Speed", ylabel="m/s", xlim=(0, study.time[-1]))
        top.tick_params(labelbottom=False)
        bottom.set(title="Progress", xlabel="time [s]", ylabel="m", xlim=(0, study.time[-1]))
        top.legend(ncols=2, loc="lower right")


def _trajectories(axes: Any, study: Fig10, start: int, colours: list) -> None:
    """Driving direction upwards, as in the paper, with the width of the road stretched."""
    leader = study.others[0, 0, start, :, LEADER]
    origin = study.ego[0, 0, start, 0, 0]
    reach = max(study.ego[:, 0, start, -1, 0].max(), leader[-1, 0]) - origin
    lanes = np.unique(np.round(study.others[0, 0, :, 0, :2, 1], 3))
    width = np.diff(lanes).min() if lanes.size > 1 else 3.5
    edges = [lanes.min() - width / 2, lanes.max() + width / 2]
    axes.axvspan(-edges[1], -edges[0], color=ROAD, zorder=0)
    for edge in edges:
        axes.axvline(-edge, color=LINE, lw=1.2)
    for middle in (lanes[1:] + lanes[:-1]) / 2:
        axes.axvline(-middle, color=LINE, lw=1.0, ls=(0, (6, 6)))
    marks = np.searchsorted(study.time, np.arange(0.0, study.time[-1] + 1e-6, 2.0) - 1e-6)
    axes.plot(-leader[:, 1], leader[:, 0] - origin, color=OTHER, lw=1.2, label="front vehicle")
    axes.plot(-leader[marks, 1], leader[marks, 0] - origin, "s", color=OTHER, ms=6)
    for i in range(len(study.taus)):
        track = study.ego[i, 0, start]
        axes.plot(-track[:, 1], track[:, 0] - origin, color=colours[i])
        axes.plot(-track[marks, 1], track[marks, 0] - origin, "o", color=colours[i], ms=3.5)
    axes.grid(axis="x", visible=False)
    axes.set(
        title="Trajectories, a mark every 2 s",
        xlabel="across the road [m], left is left",
        ylabel="along the road [m]",
        xlim=(-edges[1] - 0.7, -edges[0] + 0.7),
        ylim=(-10, reach + 10),
    )
    axes.legend(loc="upper right")


def draw_means(study: Fig10, path: Path) -> None:
    """Terminal progress, speed drop and collisions against tau over all paired starts, with and without the clamp."""
    positions = np.arange(len(study.taus))
    with figure(path, 10.0, height=3.0) as canvas:
        axes = canvas.subplots(1, 3)
        for axis, values, title, unit in (
            (axes[0], study.progress, "Terminal progress", "m"),
            (axes[1], study.drop, "Speed drop", "m/s"),
        ):
            for k, (colour, style, label) in enumerate(VARIANTS):
                low, high = np.quantile(values[:, k], (0.1, 0.9), axis=-1)
                axis.fill_between(positions, low, high, color=colour, alpha=0.12, lw=0)
                axis.plot(positions, values[:, k].mean(-1), style, color=colour, ms=4, label=label)
            axis.set(title=f"{title} (mean, 10-90 %)", ylabel=unit)
        for k, (colour, _, label) in enumerate(VARIANTS):
            axes[2].bar(positions + 0.36 * k - 0.18, study.collided[:, k].sum(-1), 0.34, color=colour, label=label)
        axes[2].set(title=f"Collisions in {study.crowded.size} starts", ylim=(0, max(study.collided.sum(-1).max(), 1)))
        if not study.collided.any():
            axes[2].text(0.5, 0.5, "none", transform=axes[2].transAxes, ha="center", color=OTHER)
        axes[2].yaxis.get_major_locator().set_params(integer=True)
        for axis in axes:
            axis.set_xticks(positions, [f"{tau:g}" for tau in study.taus])
            axis.set_xlabel(r"$\tau$")
        axes[0].legend(loc="lower right")


def pictures(study: Fig10, graph: RoadGraph, start: int, every: int) -> list[np.ndarray]:
    """Frames of one start, one strip per tau, drawn by highway-env; all strips look at the same place."""
    renderer = Renderer(graph, height=80, scaling=5.0)
    present = study.present[start]
    size = (study.vehicle.length, study.vehicle.width)
    frames = []
    for k in range(0, len(study.time), every):
        middle = np.array([study.ego[:, 0, start, k, 0].mean(), study.others[0, 0, start, k, LEADER, 1]])
        strips = []
        for i in range(len(study.taus)):
            others = study.others[i, 0, start, k][present]
            rows = np.concatenate([[[*study.ego[i, 0, start, k], *size]], others])
            collided = bool(study.collided[i, 0, start])
            strips.append(renderer.picture(rows[:, :2], rows[:, 2], rows[:, 3:], collided, middle))
        labels = [f"tau {tau:g}   {study.speed[i, 0, start, k]:4.1f} m/s" for i, tau in enumerate(study.taus)]
        frames.append(stacked(strips, labels))
    return frames
