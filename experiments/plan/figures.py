"""The picture of one plan: the fan coloured by cost, the lattice by its marginals (Fig. 4 and 8)."""

import dataclasses
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from experiments.plan.study import Moment
from urbanjax.io.figures.lattices import draw_macro
from urbanjax.io.figures.roads import draw_boxes, draw_road
from urbanjax.io.figures.style import GOOD, OTHER, figure

AHEAD, BEHIND, ASIDE = 75.0, 12.0, 10.0  # m shown around the ego
INFEASIBLE = "#c9c9c9"


def seen_from_ego(found: Moment) -> Moment:
    """The same moment in the ego's frame: x ahead and y to the left of its centre."""
    x, y, angle = found.ego[:3]
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])

    def moved(points: Any) -> Any:
        return jnp.asarray((np.asarray(points, float) - [x, y]) @ turn)

    graph, road, objects = found.course.graph, found.window, found.observation.objects
    hard, path = found.hard, found.hard.micro.path
    return dataclasses.replace(
        found,
        course=found.course.replace(graph=graph.replace(left=moved(graph.left), right=moved(graph.right))),
        window=road.replace(position=moved(road.position), heading=road.heading - angle),
        observation=found.observation.replace(
            objects=objects.replace(position=moved(objects.position), heading=objects.heading - angle)
        ),
        ego=np.array([0.0, 0.0, 0.0, *found.ego[3:]]),
        prediction=found.prediction.replace(position=moved(found.prediction.position)),
        hard=hard.replace(
            fan=hard.fan.replace(position=moved(hard.fan.position)),
            micro=hard.micro.replace(path=path.replace(position=moved(path.position))),
        ),
    )


def draw(moment: Moment, path: Path) -> None:
    """Above the fan by cost, below the macro lattice by the marginals of the soft plan, in the ego's frame."""
    found = seen_from_ego(moment)
    with figure(path, 10.5, height=5.6) as canvas:
        upper, lower = canvas.subplots(2, 1)
        for axes in (upper, lower):
            draw_road(axes, found.course.graph)
            _traffic(axes, found)
        bar = _fan(upper, found)
        canvas.colorbar(bar, ax=upper, label="cost above the least [m]", pad=0.01)
        upper.set_title("a  primitives by cost (grey: a limit is broken), the chosen one, predicted traffic")
        bar = draw_macro(lower, found.window, plan=found.soft.macro)
        canvas.colorbar(bar, ax=lower, label="marginal of the node", pad=0.01)
        lower.set_title("b  macro lattice, marginals of the soft plan")
        for axes in (upper, lower):
            axes.set(xlim=(-BEHIND, AHEAD), ylim=(-ASIDE, ASIDE), xlabel="ahead [m]", ylabel="left [m]")


def _traffic(axes: Any, found: Moment) -> None:
    objects, future = found.observation.objects, found.prediction
    there = np.asarray(objects.valid)
    boxes = np.column_stack([objects.position, objects.heading, objects.length, objects.width])[there]
    draw_boxes(axes, boxes, colour=OTHER)
    for way, valid in zip(np.asarray(future.position), np.asarray(future.valid), strict=True):
        if valid:
            axes.plot(*way.T, ".", color=OTHER, ms=2.5, alpha=0.7, zorder=4)
    draw_boxes(axes, found.ego[None], colour=GOOD)


def _fan(axes: Any, found: Moment) -> Any:
    """Candidates as lines, the cheap ones on top."""
    from matplotlib.collections import LineCollection

    micro, lines = found.hard.micro, np.asarray(found.hard.fan.position)
    broken = np.asarray(micro.reasons).any(1)
    paid = np.asarray(micro.terms).sum(1)
    axes.add_collection(LineCollection(list(lines[broken]), colors=INFEASIBLE, linewidths=0.7, zorder=2))
    order = np.argsort(-paid[~broken])
    over = paid[~broken] - paid[~broken].min(initial=np.inf) if (~broken).any() else paid[~broken]
    shown = LineCollection(list(lines[~broken][order]), cmap="plasma_r", linewidths=1.2, zorder=3)
    shown.set_array(over[order])
    axes.add_collection(shown)
    axes.plot(*np.asarray(micro.path.position).T, color=GOOD, lw=2.2, zorder=5)
    return shown
