"""One closed loop as a picture: where everybody went, and what the ego did over time."""

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from urbanjax.evaluation import metrics
from urbanjax.io.figures.roads import draw_boxes, draw_road
from urbanjax.io.figures.style import BAD, GOOD, OTHER, figure
from urbanjax.io.maps import RoadMap, Scene
from urbanjax.numerics.soft import Relaxation
from urbanjax.roadmap.graph import RoadGraph
from urbanjax.sim.log import Log
from urbanjax.types import ScenarioError
from urbanjax.vehicle.params import VehicleParams

MARGIN = 12.0  # m around the ego's way
NEAR = 40.0  # m of the ego's way, within which others are drawn
GHOSTS = 5  # boxes along the way, the last one filled
WIDE = 10.0  # inches


def drive(
    log: Log,
    map: RoadMap | RoadGraph | Scene,
    *,
    path: str | Path = "drive.png",
    vehicle: VehicleParams | None = None,
) -> Path:
    """The drive from above on its map, with speed, acceleration and gap over time; returns the path of the picture.

    The ego is green and coloured by speed along its way, red where it touches another vehicle; others are grey, with
    the ways that they went. Args: log [T], of one run; map, as read, its graph, or the scene that was driven; path of
    the picture; vehicle, the ego's dimensions (default: the scene's, or the standard ones). Raises ScenarioError for a
    log of several runs.
    """
    log = jax.tree.map(np.asarray, log)
    if np.ndim(log.time) != 1:
        raise ScenarioError(
            f"log.time has the shape {np.shape(log.time)}: a drive is one run [T]; take log[k] of a batch"
        )
    if vehicle is None:
        vehicle = map.params.vehicle if isinstance(map, Scene) else VehicleParams()
    title = map.name if isinstance(map, Scene) else map.path.stem if isinstance(map, RoadMap) else "drive"
    graph = map.map.graph if isinstance(map, Scene) else map.graph if isinstance(map, RoadMap) else map
    low, high = log.centre.min(0) - MARGIN, log.centre.max(0) + MARGIN
    span = high - low
    height = float(np.clip(WIDE * span[1] / span[0], 2.0, 8.0))
    with figure(Path(path), WIDE, height=height + 2.4) as canvas:
        grid = canvas.add_gridspec(2, 3, height_ratios=[height, 2.0])
        above = canvas.add_subplot(grid[0, :])
        draw_road(above, graph)
        _others(above, log)
        _ego(canvas, above, log, vehicle)
        above.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), title=title)
        _over_time([canvas.add_subplot(grid[1, k]) for k in range(3)], log, vehicle)
    return Path(path)


def _others(axes: Any, log: Log) -> None:
    """Everybody who came near the ego: the way, and the box where they were last."""
    from matplotlib.collections import LineCollection

    traffic = log.traffic
    away = np.linalg.norm(traffic.position - log.centre[:, None], axis=-1)
    shown = np.flatnonzero(((away < NEAR) & traffic.valid).any(0))
    ways = [traffic.position[traffic.valid[:, v], v] for v in shown]
    axes.add_collection(LineCollection(ways, colors=OTHER, linewidths=0.8, alpha=0.5, zorder=4))
    last = [len(log.time) - 1 - int(traffic.valid[::-1, v].argmax()) for v in shown]
    boxes = [
        [*traffic.position[t, v], traffic.heading[t, v], traffic.length[t, v], traffic.width[t, v]]
        for t, v in zip(last, shown, strict=True)
    ]
    if boxes:
        draw_boxes(axes, np.array(boxes, float), colour=OTHER)


def _ego(canvas: Any, axes: Any, log: Log, vehicle: VehicleParams) -> None:
    """The ego's way coloured by speed, and its box every so often."""
    from matplotlib.collections import LineCollection

    parts = np.stack([log.centre[:-1], log.centre[1:]], axis=1)
    way = LineCollection(list(parts), array=log.ego.speed[:-1], cmap="viridis", linewidths=2.4, zorder=5)
    axes.add_collection(way)
    canvas.colorbar(way, ax=axes, label="speed [m/s]", shrink=0.8)
    size = float(vehicle.length), float(vehicle.width)
    steps = np.unique(np.linspace(0, len(log.time) - 1, GHOSTS).astype(int))
    boxes = np.array([[*log.centre[k], log.ego.heading[k], *size] for k in steps], float)
    draw_boxes(axes, boxes[:-1], colour=GOOD, filled=False)
    draw_boxes(axes, boxes[-1:], colour=GOOD)
    touching = _gap(log, vehicle) <= 0
    if touching.any():
        axes.plot(*log.centre[touching].T, "x", color=BAD, ms=8, mew=2, zorder=7, label="touches another vehicle")
        axes.legend(loc="best")


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
    gap.set(title="gap to the nearest vehicle [m]", xlabel="time [s]")
