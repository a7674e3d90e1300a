"""One closed loop as a picture: where everybody went, and what the ego did over time."""

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from urbanjax.evaluation import metrics
from urbanjax.io.figures.roads import draw_boxes, draw_road
from urbanjax.io.figures.style import BAD, GOOD, OTHER, figure
from urbanjax.io.files import path_of
from urbanjax.io.maps import RoadMap, Scene
from urbanjax.numerics.soft import Relaxation
from urbanjax.roadmap.graph import RoadGraph
from urbanjax.sim.checks import off_lanes
from urbanjax.sim.log import Log
from urbanjax.types import FileError, ScenarioError
from urbanjax.types.arguments import kind
from urbanjax.vehicle.params import VehicleParams

PLACES = 50  # along the way, that are looked up on the map
ELSEWHERE = 2.0  # m (median), beyond which the way is not on the map
MARGIN = 12.0  # m around the ego's way
SUFFIXES = (".png", ".pdf", ".svg")
WAY = "#b07d62"  # of others
NEAR = 40.0  # m of the ego's way, within which others are drawn
GHOSTS = 5  # boxes along the way, the last one filled
LONGEST = 9.0  # inches, of the road seen from above


def drive(
    log: Log,
    map: RoadMap | RoadGraph | Scene,
    *,
    path: str | Path = "drive.png",
    vehicle: VehicleParams | None = None,
) -> Path:
    """The drive from above on its map, with speed, acceleration and gap over time; returns the path of the picture.

    The ego is green and coloured by speed along its way, red where it touches another vehicle or leaves the road;
    others are grey, with the ways that they went. Args: log [T], of one run; map, as read, its graph, or the scene that
    was driven; path of the picture (png, pdf or svg); vehicle, the ego's dimensions (default: the scene's, or the
    standard ones). Raises ScenarioError for what is no log of one run on that map, FileError for a path that no picture
    can have.
    """
    vehicle = map.params.vehicle if vehicle is None and isinstance(map, Scene) else vehicle
    vehicle = metrics.checked(jax.tree.map(jnp.asarray, log) if isinstance(log, Log) else log, vehicle)
    kind(map, "map", wanted=(RoadMap, RoadGraph, Scene), error=ScenarioError)
    log = jax.tree.map(np.asarray, log)
    title = map.name if isinstance(map, Scene) else map.path.stem if isinstance(map, RoadMap) else "drive"
    graph = map.map.graph if isinstance(map, Scene) else map.graph if isinstance(map, RoadMap) else map
    target = _target(path)
    _check_place(log, graph)
    low, high = log.centre.min(0) - MARGIN, log.centre.max(0) + MARGIN
    width, height = np.clip((high - low) * LONGEST / (high - low).max(), (6.5, 2.0), LONGEST)
    with figure(target, float(width) + 1.0, height=float(height) + 2.6) as canvas:
        grid = canvas.add_gridspec(2, 3, height_ratios=[height, 1.9])
        above = canvas.add_subplot(grid[0, :])
        draw_road(above, graph)
        _others(above, log)
        _ego(canvas, above, log, vehicle)
        above.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), title=title)
        above.legend(loc="best", fontsize=7)
        _over_time([canvas.add_subplot(grid[1, k]) for k in range(3)], log, vehicle)
    return target


def _check_place(log: Log, graph: RoadGraph) -> None:
    """Raise ScenarioError where the ego is not as near to a lane of the graph as the log says."""
    steps = np.unique(np.linspace(0, len(log.time) - 1, PLACES).astype(int))
    away = [off_lanes(graph, np.asarray(log.centre[k], float)) - abs(float(log.offset[k])) for k in steps]
    if np.median(away) > ELSEWHERE:
        raise ScenarioError(
            f"log: its way lies {np.median(away):.0f} m farther from the map's nearest lane than it says: give the map "
            "that was driven on"
        )


def _target(path: str | Path) -> Path:
    """Where the picture goes. Raises FileError for a folder, a suffix or a place that no picture can have."""
    target = path_of(path)
    if target.name and not target.suffix and not target.is_dir():
        target = target.with_name(f"{target.name}.png")
    if target.suffix.lower() not in SUFFIXES or target.is_dir():
        raise FileError(f"{path!s}: is no name for a picture; let it end in {', '.join(SUFFIXES)}")
    if not target.absolute().parent.is_dir():
        raise FileError(f"{target}: there is no folder {target.absolute().parent}; make it first")
    return target


def _others(axes: Any, log: Log) -> None:
    """Everybody who came near the ego: the way, and the box at the end of those who are still there."""
    from matplotlib.collections import LineCollection

    traffic = log.traffic
    away = np.linalg.norm(traffic.position - log.centre[:, None], axis=-1)
    shown = np.flatnonzero(((away < NEAR) & traffic.valid).any(0))
    ways = [traffic.position[traffic.valid[:, v], v] for v in shown]
    axes.add_collection(LineCollection(ways, colors=WAY, linewidths=1.2, zorder=4, label="ways of others"))
    there = [v for v in shown if traffic.valid[-1, v]]
    rows = [
        [*traffic.position[-1, v], traffic.heading[-1, v], traffic.length[-1, v], traffic.width[-1, v]] for v in there
    ]
    if rows:
        draw_boxes(axes, np.array(rows, float), colour=OTHER)


def _ego(canvas: Any, axes: Any, log: Log, vehicle: VehicleParams) -> None:
    """The ego's way coloured by speed, its box every so often, and where it touches somebody or leaves the road."""
    from matplotlib.collections import LineCollection

    parts = np.stack([log.centre[:-1], log.centre[1:]], axis=1)
    way = LineCollection(list(parts), array=log.ego.speed[:-1], cmap="viridis", linewidths=2.4, zorder=5)
    axes.add_collection(way)
    canvas.colorbar(way, ax=axes, label="speed [m/s]", fraction=0.03, pad=0.01)
    size = float(vehicle.length), float(vehicle.width)
    steps = np.unique(np.linspace(0, len(log.time) - 1, GHOSTS).astype(int))
    boxes = np.array([[*log.centre[k], log.ego.heading[k], *size] for k in steps], float)
    draw_boxes(axes, boxes[:-1], colour=GOOD, filled=False)
    draw_boxes(axes, boxes[-1:], colour=GOOD)
    every = float(log.time[steps[1]] - log.time[steps[0]])
    axes.plot([], [], "s", color=GOOD, ms=7, label=f"ego at the end, outlined every {every:.1f} s")
    axes.plot([], [], "s", color=OTHER, ms=7, label="others at the end")
    for bad, marker, label in (
        (_gap(log, vehicle) <= 0, "x", "touches another vehicle"),
        (log.road_margin < 0, "_", "off the road"),
    ):
        if bad.any():
            axes.plot(*log.centre[bad].T, marker, color=BAD, ms=7, mew=2, ls="none", zorder=7, label=label)


def _gap(log: Log, vehicle: VehicleParams) -> np.ndarray:
    """Distance [T] m to the nearest other vehicle; NaN where there is none."""
    gaps, others = metrics.clearance(jax.tree.map(jnp.asarray, log), vehicle, relaxation=Relaxation())
    return np.where(others, gaps, np.nan)


def _over_time(panels: list[Any], log: Log, vehicle: VehicleParams) -> None:
    time = log.time - log.time[0]
    speed, push, gap = panels
    speed.plot(time, log.ego.speed, color=GOOD)
    speed.set(title="speed [m/s]", xlabel="time [s]", ylim=(0, None))
    lateral = metrics.lateral_acceleration(jax.tree.map(jnp.asarray, log), vehicle)
    push.plot(time, log.ego.acceleration, color=GOOD, label="along")
    push.plot(time, lateral, color=OTHER, label="sideways")
    push.set(title="acceleration [m/s²]", xlabel="time [s]")
    push.legend(loc="best")
    away = _gap(log, vehicle)
    if np.isfinite(away).any():
        gap.plot(time, away, color=GOOD)
        gap.axhline(0, color=BAD, lw=0.8)
    else:
        gap.text(0.5, 0.5, "nobody else", ha="center", transform=gap.transAxes)
        gap.set(xticks=[], yticks=[])
    gap.set(title="gap to the nearest vehicle [m]", xlabel="time [s]")
