"""The figures of an evaluation."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments.evaluate import tables
from experiments.evaluate.tables import Rows
from urbanjax.io.figures.roads import draw_boxes, draw_road
from urbanjax.io.figures.style import BAD, GOOD, OTHER, STYLE, figure, shades
from urbanjax.roadmap.graph import RoadGraph
from urbanjax.sim.log import Log
from urbanjax.vehicle.params import VehicleParams

MARGIN = 14.0  # m around the ego's way
NEAR = 45.0  # m, within which others are drawn
GHOSTS = 6  # boxes along a way
VIEW = 40.0, 16.0  # m, half of what a moving picture shows
DPI = 80


def draw_success(rows: Rows, path: Path) -> None:
    """Success and nuPlan score of every driver by mission, with 95 % intervals; for the first kind of traffic."""
    rows = tables.chosen(rows, traffic=rows[0]["traffic"])
    missions, drivers = tables.names(rows, "mission"), tables.names(rows, "driver")
    with figure(path, 10.5, height=1.6 + 0.42 * len(missions)) as canvas:
        panels = canvas.subplots(1, 2, sharey=True)
        for k, (driver, colour) in enumerate(zip(drivers, shades(len(drivers)), strict=True)):
            shift = 0.6 * (k - (len(drivers) - 1) / 2) / max(len(drivers), 1)
            parts = [tables.chosen(rows, driver=driver, mission=mission) for mission in missions]
            for axes, found in (
                (panels[0], [tables.success(part).percent for part in parts]),
                (panels[1], [tables.mean(part, "nuplan_total") for part in parts]),
            ):
                value, low, high = np.array(found, float).T
                at = np.arange(len(missions)) + shift
                reach = np.nan_to_num(np.abs(np.stack([value - low, high - value])))
                axes.errorbar(value, at, xerr=reach, fmt="o", ms=4, color=colour, label=driver, lw=1.2)
        panels[0].set(yticks=range(len(missions)), yticklabels=missions, title="success [%]", xlim=(-4, 104))
        panels[1].set(title="nuPlan score", xlim=(-0.04, 1.04))
        panels[0].invert_yaxis()
        panels[1].legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


def draw_matrix(rows: Rows, path: Path) -> None:
    """Success [%] of every driver in every kind of traffic."""
    drivers, kinds = tables.names(rows, "driver"), tables.names(rows, "traffic")
    found = [[tables.success(tables.chosen(rows, driver=d, traffic=t)).percent for t in kinds] for d in drivers]
    with figure(path, 2.6 + 1.5 * len(kinds), height=1.4 + 0.5 * len(drivers)) as canvas:
        axes = canvas.add_subplot()
        axes.imshow([[x.value for x in line] for line in found], vmin=0, vmax=100, cmap="RdYlGn", aspect="auto")
        for i, line in enumerate(found):
            for j, x in enumerate(line):
                axes.text(j, i, x.text(0), ha="center", va="center", fontsize=8)
        axes.set(xticks=range(len(kinds)), xticklabels=kinds, yticks=range(len(drivers)), yticklabels=drivers)
        axes.grid(visible=False)
        axes.set_title("success [%] by driver and traffic")


def draw_gallery(drives: Sequence[tuple[str, Log, RoadGraph, VehicleParams, bool]], path: Path) -> None:
    """One drive of each mission from above.

    Args: drives: title, log until the end, road, vehicle, whether it failed.
    """
    across = min(len(drives), 2)
    rows = math.ceil(len(drives) / across)
    with figure(path, 5.5 * across, height=2.5 * rows) as canvas:
        panels = np.ravel(canvas.subplots(rows, across, squeeze=False))
        for axes, (title, log, graph, vehicle, failed) in zip(panels, drives, strict=False):
            _from_above(axes, *_turned(log, graph), vehicle, BAD if failed else GOOD)
            axes.set(title=title, xlabel="", ylabel="")
        for axes in panels[len(drives) :]:
            axes.set_axis_off()


def _turned(log: Log, graph: RoadGraph) -> tuple[Log, RoadGraph]:
    """Both in a frame in which the drive leads to the right."""
    step = log.centre[-1] - log.centre[0]
    angle = -float(np.arctan2(step[1], step[0]))
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])

    def at(points: Any) -> Any:
        return (np.asarray(points, float) - log.centre[0]) @ turn

    ego, others = log.ego.replace(heading=log.ego.heading + angle), log.traffic
    others = others.replace(position=at(others.position), heading=others.heading + angle)
    road = graph.replace(left=at(graph.left), right=at(graph.right))
    return log.replace(centre=at(log.centre), ego=ego, traffic=others), road


def _from_above(axes: Any, log: Log, graph: RoadGraph, vehicle: VehicleParams, colour: str) -> None:
    """The ways of all, the ego's box every so often, the others' boxes at the end."""
    draw_road(axes, graph)
    others = log.traffic
    away = np.linalg.norm(others.position - log.centre[:, None], axis=-1)
    for v in np.flatnonzero(((away < NEAR) & others.valid).any(0)):
        there = others.valid[:, v]
        axes.plot(*others.position[there, v].T, color=OTHER, lw=0.8, zorder=4)
        last = np.flatnonzero(there)[-1]
        draw_boxes(axes, _boxes_of_others(log, last, [v]), colour=OTHER)
    steps = np.unique(np.linspace(0, len(log.time) - 1, GHOSTS).astype(int))
    axes.plot(*log.centre.T, color=colour, lw=1.4, zorder=5)
    draw_boxes(axes, _boxes_of_ego(log, steps, vehicle), colour=colour, filled=False)
    draw_boxes(axes, _boxes_of_ego(log, steps[-1:], vehicle), colour=colour)
    low, high = log.centre.min(0) - MARGIN, log.centre.max(0) + MARGIN
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))


def _boxes_of_ego(log: Log, steps: Any, vehicle: VehicleParams) -> np.ndarray:
    size = float(vehicle.length), float(vehicle.width)
    return np.array([[*log.centre[k], log.ego.heading[k], *size] for k in steps], float)


def _boxes_of_others(log: Log, step: int, which: Any) -> np.ndarray:
    there = log.traffic
    names = ("heading", "length", "width")
    rows = [[*there.position[step, v], *(getattr(there, name)[step, v] for name in names)] for v in which]
    return np.array(rows, float).reshape(-1, 5)


def moving(log: Log, graph: RoadGraph, vehicle: VehicleParams, *, every: int, title: str) -> list[np.ndarray]:
    """Pictures [H, W, 3] of a drive, the ego in the middle. Args: every, steps between two; title, of all."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    frames = []
    with matplotlib.rc_context(STYLE):
        picture = Figure(figsize=(8.0, 3.6), dpi=DPI)
        canvas = FigureCanvasAgg(picture)
        axes = picture.add_subplot()
        draw_road(axes, graph)
        still = len(axes.collections)
        for k in range(0, len(log.time), every):
            there = np.flatnonzero(log.traffic.valid[k])
            others = _boxes_of_others(log, k, there)
            ego = _boxes_of_ego(log, [k], vehicle)
            draw_boxes(axes, others, colour=OTHER)
            draw_boxes(axes, ego, colour=GOOD)
            x, y = log.centre[k]
            axes.set(xlim=(x - VIEW[0], x + VIEW[0]), ylim=(y - VIEW[1], y + VIEW[1]))
            axes.set_title(f"{title}, {log.time[k] - log.time[0]:.1f} s, {log.ego.speed[k]:.1f} m/s")
            canvas.draw()
            frames.append(np.asarray(canvas.buffer_rgba())[..., :3].copy())
            for artist in list(axes.collections)[still:]:
                artist.remove()
    return frames
