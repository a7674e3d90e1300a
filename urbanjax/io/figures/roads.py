"""Road graphs and the vehicles on them seen from above."""

from typing import Any

import jax
import numpy as np
from jax import Array

from urbanjax.geometry.boxes import box, corners
from urbanjax.io.figures.style import LINE, ROAD
from urbanjax.roadmap.graph import RoadGraph, RoadType
from urbanjax.types import as_arrays

FILLS = {RoadType.JUNCTION: "#dfe7ef", RoadType.HIGHWAY: "#efe9dc", RoadType.RAMP: "#f3e3d3"}


def draw_road(axes: Any, graph: RoadGraph, *, line: float = 0.6) -> None:
    """Surface and borders of each lane, at one scale for both axes.

    Grey lanes are roads, blue ones links inside junctions, ochre ones highways.
    Args: axes of matplotlib; graph, the road graph; line, width of borders in points.
    """
    from matplotlib.collections import LineCollection, PolyCollection

    there = np.asarray(graph.valid)
    left, right, kinds = (np.asarray(x)[there] for x in (graph.left, graph.right, graph.road_type))
    fills = [FILLS.get(RoadType(int(kind)), ROAD) for kind in kinds]
    order = np.argsort(kinds == RoadType.JUNCTION, kind="stable")[::-1]
    outline = np.concatenate([left, right[:, ::-1]], axis=1)
    axes.add_collection(PolyCollection(list(outline[order]), facecolors=[fills[i] for i in order], edgecolors="none"))
    faint = line * np.where(kinds == RoadType.JUNCTION, 0.25, 0.6)
    for border in (left, right):
        axes.add_collection(LineCollection(list(border), colors=LINE, linewidths=faint))
    axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    axes.autoscale_view()


def draw_boxes(axes: Any, boxes: np.ndarray, *, colour: str, filled: bool = True) -> None:
    """Vehicles from above, filled or as outlines.

    Args: axes of matplotlib; boxes [n, 5] of x, y (m) of the centre, heading (rad), length, width (m); colour,
    matplotlib's; filled, or outlines only.
    """
    from matplotlib.collections import PolyCollection

    style = {"facecolors": colour, "alpha": 0.85, "lw": 0} if filled else {"facecolors": "none", "lw": 0.8}
    outlines = _outlines(as_arrays(boxes))
    axes.add_collection(PolyCollection(list(np.asarray(outlines)), edgecolors=colour, zorder=6, **style))


@jax.jit
def _outlines(boxes: Array) -> Array:
    """Corners [n, 4, 2] m of boxes [n, 5] as `draw_boxes` takes them."""
    return corners(box(boxes[:, :2], boxes[:, 2], length=boxes[:, 3], width=boxes[:, 4]))
