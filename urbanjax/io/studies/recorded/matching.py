"""Which links a recorded vehicle drove on: the most plausible connected sequence (host side)."""

import numpy as np

from urbanjax.roadmap.graph import RoadGraph

FARTHEST = 6.0  # m from a link's centre line, beyond which nobody is on it
CLOSE = 3.0  # m, within which a place may be on a link
HEADING = 4.0  # m per squared rad of deviation from the link's direction
JUMP = 1e3  # m, for going on on a link that does not follow
SIDE = 3.0  # m, for a change of lanes
HOPS = 3  # links that may be passed between two records


def match(graph: RoadGraph, position: np.ndarray, heading: np.ndarray) -> np.ndarray | None:
    """Link of each of T poses, the cheapest sequence by distance and connection (Viterbi); None off the road.

    Args: position [T, 2] m, heading [T] rad.
    """
    cost = _misfit(graph, position, heading)
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


def near(graph: RoadGraph, position: np.ndarray, heading: float | None) -> list[int]:
    """Links within 3 m of a place [2] (m) and along its heading (rad, None: any), the best fit first."""
    if heading is None:
        fits = np.min([_misfit(graph, position[None], np.array([a]))[0] for a in np.arange(0, 2 * np.pi, 0.3)], axis=0)
    else:
        fits = _misfit(graph, position[None], np.array([heading]))[0]
    return [int(link) for link in np.argsort(fits, kind="stable") if fits[link] < CLOSE]


def _misfit(graph: RoadGraph, position: np.ndarray, heading: np.ndarray) -> np.ndarray:
    """How badly [T, L] (m) each pose fits each link."""
    centre, course, valid = (np.asarray(x) for x in (graph.centre, graph.heading, graph.valid))
    start, chord = centre[:, :-1], np.diff(centre, axis=1)
    size = np.maximum((chord**2).sum(-1), 1e-9)
    cost = np.empty((len(position), len(centre)))
    for t, (point, angle) in enumerate(zip(position, heading, strict=True)):
        away = point - start
        share = np.clip((away * chord).sum(-1) / size, 0, 1)
        square = ((away - share[..., None] * chord) ** 2).sum(-1)
        nearest = square.argmin(1)[:, None]
        turned = angle - np.take_along_axis(course, nearest, 1)[:, 0]
        turned = (turned + np.pi) % (2 * np.pi) - np.pi
        cost[t] = np.sqrt(np.take_along_axis(square, nearest, 1)[:, 0]) + HEADING * turned**2
    return np.where(valid, cost, 1e6)


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
        cost = np.minimum(cost, np.where(reach, 0.01 * hop, JUMP))
    for side, there in ((graph.left_link, graph.has_left), (graph.right_link, graph.has_right)):
        rows = np.flatnonzero(np.asarray(there))
        for row in rows:
            to = int(np.asarray(side)[row])
            cost[row] = np.minimum(cost[row], SIDE + cost[to])
    return cost
