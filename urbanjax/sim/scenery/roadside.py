"""The sides of a road graph's carriageways, as stations and offsets (host side)."""

from dataclasses import dataclass

import numpy as np

from urbanjax.roadmap.graph import RoadGraph

LEAST_STEP = 1e-6  # m, between two points of a border where consecutive links share one: stations rise
JOIN = 4.5  # m, over which two borders are one side of the road: a lane more or less


@dataclass(frozen=True)
class Roadside:
    """One side of a carriageway, in driving direction."""

    station: np.ndarray  # [N] m, along the border
    position: np.ndarray  # [N, 2] m
    heading: np.ndarray  # [N] rad, unwrapped
    outward: float  # 1: the land is on the left, -1: on the right

    @property
    def length(self) -> float:
        """Metres along the border."""
        return float(self.station[-1])

    def at(self, station: np.ndarray, offset: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions [M, 2] `offset` m away from the lanes and headings [M] of the road there."""
        x, y = (np.interp(station, self.station, self.position[:, k]) for k in (0, 1))
        heading = np.interp(station, self.station, self.heading)
        aside = self.outward * offset
        return np.stack([x - aside * np.sin(heading), y + aside * np.cos(heading)], axis=-1), heading


def roadsides(graph: RoadGraph) -> list[Roadside]:
    """All sides: borders without a neighbour beyond, those of consecutive links joined. Args: graph, the road graph."""
    found = []
    valid, heading = np.asarray(graph.valid), np.asarray(graph.heading, float)
    for border, has, outward in ((graph.left, graph.has_left, 1.0), (graph.right, graph.has_right, -1.0)):
        links = np.flatnonzero(valid & ~np.asarray(has))
        points = np.asarray(border, float)[links]
        for chain in _chains(points):
            position = np.concatenate([points[k] for k in chain])
            turned = np.unwrap(np.concatenate([heading[links[k]] for k in chain]))
            step = np.linalg.norm(np.diff(position, axis=0), axis=1)
            station = np.concatenate([[0.0], np.cumsum(np.maximum(step, LEAST_STEP))])
            found.append(Roadside(station, position, turned, outward))
    return found


def _chains(points: np.ndarray) -> list[list[int]]:
    """Polylines [E, P, 2] in runs, each of which begins near the end of the one before."""
    gap = np.linalg.norm(points[:, None, -1] - points[None, :, 0], axis=-1)
    follows: dict[int, int] = {}
    for k in np.argsort(gap.min(axis=1)):
        free = np.where(np.isin(np.arange(len(points)), list(follows.values())), np.inf, gap[k])
        if free.min() < JOIN:
            follows[int(k)] = int(np.argmin(free))
    heads = [k for k in range(len(points)) if k not in follows.values()]
    chains, left = [], set(range(len(points)))
    for head in [*heads, *range(len(points))]:
        chain, k = [], head
        while k in left:
            left.remove(k)
            chain.append(k)
            k = follows.get(k, -1)
        chains += [chain] if chain else []
    return chains
