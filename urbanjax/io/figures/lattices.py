"""Lattices seen from above: nodes, edges, their weights and the path through them."""

from typing import Any

import jax
import numpy as np

from urbanjax.io.figures.style import BAD
from urbanjax.planning.macro import MacroPlan
from urbanjax.roadmap.corridor import Corridor
from urbanjax.roadmap.progress import to_world

SHOWN = 1e-3  # weight from which a node or an edge is drawn in colour
MARGINAL = "viridis_r"


def draw_lattice(
    axes: Any,
    position: np.ndarray,
    *,
    weight: np.ndarray,
    there: np.ndarray | None = None,
    edges: np.ndarray | None = None,
    path: np.ndarray | None = None,
    size: float = 7.0,
) -> Any:
    """Nodes coloured by their weight, edges as thin lines, the path on top; returns what a colour bar is made of.

    Args: axes of matplotlib; position [S, M, 2] m; weight [S, M] in [0, 1]; there [S, M], which nodes exist (None:
    all); edges [e, M, M], which to draw (from layer i to i + 1, the last back to the first where e = S); path [n, 2] m;
    size of the nodes in points.
    """
    from matplotlib.collections import LineCollection

    there = np.ones(weight.shape, bool) if there is None else there
    if edges is not None:
        step, row, column = np.nonzero(edges)
        ends = np.stack([position[step, row], position[(step + 1) % len(position), column]], axis=1)
        axes.add_collection(LineCollection(list(ends), colors="#b9c4d4", linewidths=0.25, zorder=2))
    axes.scatter(*position[there].T, s=size / 4, color="#8a97aa", lw=0, zorder=3)
    seen = there & (weight > SHOWN)
    order = np.argsort(weight[seen])
    dots = axes.scatter(
        *position[seen][order].T,
        c=weight[seen][order],
        s=size,
        cmap=MARGINAL,
        vmin=0,
        vmax=weight.max(),
        lw=0,
        zorder=5,
    )
    if path is not None:
        axes.plot(*path.T, color=BAD, lw=1.2, zorder=4)
    return dots


def macro_nodes(window: Corridor, plan: MacroPlan) -> tuple[np.ndarray, np.ndarray]:
    """Positions [S, M, 2] of a macro plan's nodes and [S + 1, 2] of the plan from the ego on, in metres.

    Args: window, the corridor that the plan is in; plan, a macro plan.
    """
    station = np.broadcast_to(np.asarray(plan.station)[:, None], plan.node_offset.shape)
    nodes = np.asarray(_world(window, station, offset=plan.node_offset)[0])
    stations = np.concatenate([np.asarray(plan.start_station)[None], plan.station])
    offsets = np.concatenate([np.asarray(plan.start_offset)[None], plan.offset])
    return nodes, np.asarray(_world(window, stations, offset=offsets)[0])


def draw_macro(axes: Any, window: Corridor, *, plan: MacroPlan) -> Any:
    """A macro plan's lattice with the weight of each node and the plan itself; returns what a colour bar is made of.

    Nodes off the road are left out.
    Args: axes of matplotlib; window, the corridor that the plan is in; plan, a macro plan.
    """
    nodes, path = macro_nodes(window, plan)
    lanes = window.has_lane.shape[1]
    row = np.clip(np.searchsorted(np.asarray(window.station), np.asarray(plan.station)), 0, len(window.station) - 1)
    there = np.repeat(np.asarray(window.has_lane)[row], plan.node_offset.shape[1] // lanes, axis=1)
    return draw_lattice(axes, nodes, weight=np.asarray(plan.marginal), there=there, path=path, size=22.0)


_world = jax.jit(to_world)
