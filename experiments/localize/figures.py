"""The figures of the localization study."""

from pathlib import Path
from typing import Any

import numpy as np

from experiments.common.district import World
from experiments.localize.faults import KINDS, WRONG, InjectedFault
from experiments.localize.methods import Method
from experiments.localize.track import LocalizedTrack
from urbanjax.io.figures.style import BAD, GOOD, LINE, OTHER, figure, shades
from urbanjax.localization.types import Health

COLOURS = {"LiDAR odometry": "#d98e04", "scan match w/o": BAD, "proposed": GOOD}  # drawn in this order
THIN = 40_000  # points of the map that are drawn


def draw_fig7(world: World, methods: list[Method], path: Path) -> None:
    """Over the point-cloud map: the paths of the methods (a), and where odometry and plain matching leave (b)."""
    truth = np.asarray(world.tour.ego.position)
    named = {m.name: m for m in methods}
    some = [named[name] for name in COLOURS]
    with figure(path, 10.5, height=5.4) as canvas:
        grid = canvas.add_gridspec(2, 2, width_ratios=(1.6, 1.0))
        whole, drift, lost = (canvas.add_subplot(place) for place in (grid[:, 0], grid[0, 1], grid[1, 1]))
        for axes in (whole, drift, lost):
            _map(axes, world)
            axes.plot(*truth.T, color="black", lw=3.0, alpha=0.25, label="truth")
            for m in some:
                axes.plot(m.path[:, 0], m.path[:, 1], color=COLOURS[m.name], lw=1.4, label=m.name)
            axes.set_aspect("equal")
        whole.set(title="(a) one lap of the district", xlabel="x [m]", ylabel="y [m]")
        whole.legend(loc="upper center", ncols=2, framealpha=0.9, frameon=True)
        margin = 60.0
        whole.set_xlim(truth[:, 0].min() - margin, truth[:, 0].max() + margin)
        whole.set_ylim(truth[:, 1].min() - margin, truth[:, 1].max() + 2.2 * margin)
        odometry, plain = named["LiDAR odometry"], named["scan match w/o"]
        _zoom(drift, odometry.path[int(np.argmax(odometry.distance)), :2], 25.0)
        drift.set_title(f"(b) odometry, where it is {odometry.distance.max():.1f} m off")
        at = plain.diverged
        where = truth[at] if at is not None else truth[len(truth) // 2]
        _zoom(lost, where, 40.0)
        lost.set_title("(c) matching alone is lost" if at is not None else "(c) matching alone is not lost")


def _map(axes: Any, world: World) -> None:
    points = world.points.position
    points = points[points[:, 2] > 0.3]
    every = max(len(points) // THIN, 1)
    axes.scatter(points[::every, 0], points[::every, 1], s=0.15, color=LINE, lw=0, rasterized=True)
    axes.grid(visible=False)


def _zoom(axes: Any, middle: np.ndarray, reach: float) -> None:
    axes.set_xlim(middle[0] - 1.5 * reach, middle[0] + 1.5 * reach)
    axes.set_ylim(middle[1] - reach, middle[1] + reach)


def draw_errors(world: World, methods: list[Method], tracks: dict[str, LocalizedTrack], path: Path) -> None:
    """Error, speed, inlier share and time per scan along the drive."""
    main = tracks["proposed"]
    time = np.asarray(world.tour.time)
    with figure(path, 10.0, height=7.0) as canvas:
        axes = canvas.subplots(4, 1, sharex=True)
        for m in methods:
            if m.name in COLOURS:
                axes[0].semilogy(time[: len(m.distance)], m.distance, color=COLOURS[m.name], lw=0.9, label=m.name)
        axes[0].axhline(WRONG, color="black", lw=0.8, ls="--")
        axes[0].set(title="Planar error", ylabel="m", ylim=(1e-4, 3e2))
        axes[0].legend(ncols=3, loc="upper left")
        axes[1].plot(time, 3.6 * np.asarray(world.tour.ego.speed), color=OTHER)
        axes[1].set(title="Speed", ylabel="km/h")
        axes[2].plot(time[main.index], main.rows.inlier_share, color=GOOD, lw=0.9)
        axes[2].set(title="Share of the scan that the map explains", ylabel="share", ylim=(0, 1))
        axes[3].plot(time[main.index][1:], main.milliseconds[1:], color=GOOD, lw=0.7)
        axes[3].axhline(100, color="black", lw=0.8, ls="--")
        axes[3].set(title="Time of a step", ylabel="ms", xlabel="time [s]", ylim=(0, None))


def draw_faults(faults: list[InjectedFault], period: float, path: Path) -> None:
    """Error and state over time around each failure, one column per kind."""
    kinds = [kind for kind in KINDS if any(fault.kind == kind for fault in faults)]
    colours = shades(len(Health))
    with figure(path, 11.0, height=4.6) as canvas:
        axes = canvas.subplots(2, len(kinds), sharex="col", sharey="row", squeeze=False)
        for column, kind in enumerate(kinds):
            for fault in (f for f in faults if f.kind == kind):
                time = period * (np.arange(len(fault.track.distance)) - fault.begin)
                axes[0, column].semilogy(time, np.maximum(fault.track.distance, 1e-4), color=OTHER, lw=0.6, alpha=0.6)
                health = fault.track.rows.health
                for state in Health:
                    there = (health == state) & (fault.track.distance > WRONG)
                    axes[0, column].plot(time[there], fault.track.distance[there], ".", ms=2.5, color=colours[state])
                jitter = 0.012 * (fault.seed % 20) - 0.12
                axes[1, column].plot(time, health + jitter, lw=0.7, color=OTHER, alpha=0.6)
            axes[0, column].axhline(WRONG, color="black", lw=0.8, ls="--")
            axes[0, column].set_title(kind.replace("_", " "))
            axes[1, column].set_xlabel("since it began [s]")
        axes[0, 0].set_ylabel("planar error [m]")
        axes[1, 0].set_yticks(list(Health), [state.name.lower() for state in Health])
        marks = [axes[0, 0].plot([], [], ".", color=colours[state], label=state.name.lower())[0] for state in Health]
        canvas.legend(handles=marks, loc="outside lower center", ncols=5, title=f"off by {WRONG} m in state")
