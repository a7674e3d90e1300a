"""Which links a recorded vehicle drove on: the most plausible connected sequence (host side)."""

import jax
import numpy as np

from urbanjax.roadmap.graph import RoadGraph
from urbanjax.roadmap.locate import LocateParams, misfit
from urbanjax.types import as_arrays

FARTHEST = 6.0  # m from a link's centre line, beyond which nobody is on it
CLOSE = 3.0  # m, within which a place may be on a link
ALONG = LocateParams(heading_weight=4.0, heading_penalty=0.0)  # m per squared rad, however far off
ANYHOW = LocateParams(heading_weight=0.0, heading_penalty=0.0)
HOP = 0.01  # m, for each link that is passed
JUMP = 1e3  # m, for going on on a link that does not follow
SIDE = 3.0  # m, for a change of lanes
HOPS = 3  # links that may be passed between two records
PADDED = 64  # poses are looked at in multiples of so many, so that few programs are compiled


def match(graph: RoadGraph, position: np.ndarray, *, heading: np.ndarray) -> np.ndarray | None:
    """Link of each of T poses, the cheapest sequence by distance and connection (Viterbi); None off the road.

    Args: graph, the road graph; position [T, 2] m; heading [T] rad.
    """
    cost = _fits(graph, position, heading, ALONG)
    if (cost.min(1) > FARTHEST).any():
        return None
    moves = _transitions(graph)
    total, back = cost[0], []
    for row in cost[1:]:
        through = total[:, None] + moves
        best = through.argmin(0)
        back.append(best)
        total = through[best, np.arange(len(best))] + row
    links = [int(total.argmin())]
    for best in reversed(back):
        links.append(int(best[links[-1]]))
    return np.array(links[::-1])


def near(graph: RoadGraph, position: np.ndarray, *, heading: float | None) -> list[int]:
    """Links within 3 m of a place [2] (m) and along its heading (rad, None: any), the best fit first.

    Args: graph, the road graph; position [2] m; heading rad (None: any).
    """
    fits = _fits(graph, position[None], np.array([heading or 0.0]), ANYHOW if heading is None else ALONG)[0]
    return [int(link) for link in np.argsort(fits, kind="stable") if fits[link] < CLOSE]


def _fits(graph: RoadGraph, position: np.ndarray, heading: np.ndarray, params: LocateParams) -> np.ndarray:
    """How badly [T, L] (m) each pose fits each link."""
    more = -len(position) % PADDED
    poses = np.pad(position, ((0, more), (0, 0)), mode="edge"), np.pad(heading, (0, more), mode="edge")
    at, angle, weights = as_arrays((*poses, params))
    return np.asarray(_misfit(graph, at, heading=angle, params=weights), float)[: len(position)]


_misfit = jax.jit(misfit)


def _transitions(graph: RoadGraph) -> np.ndarray:
    """Cost [L, L] (m) of being on one link and then on another."""
    n = graph.centre.shape[0]
    step = np.zeros((n, n), bool)
    has, following = np.asarray(graph.has_successor), np.asarray(graph.successor)
    rows, columns = np.nonzero(has)
    step[rows, following[rows, columns]] = True
    cost = np.where(np.eye(n, dtype=bool), 0.0, JUMP)
    reach = np.eye(n, dtype=bool)
    for hop in range(1, HOPS + 1):
        reach = (reach.astype(int) @ step.astype(int)) > 0
        cost = np.minimum(cost, np.where(reach, HOP * hop, JUMP))
    for side, there in ((graph.left_link, graph.has_left), (graph.right_link, graph.has_right)):
        rows = np.flatnonzero(np.asarray(there))
        for row in rows:
            to = int(np.asarray(side)[row])
            cost[row] = np.minimum(cost[row], SIDE + cost[to])
    return cost
