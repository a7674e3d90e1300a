"""What stands beside the road: buildings, walls, trees, poles and parked cars, all of them vertical prisms."""

import dataclasses
from typing import Any

import numpy as np
from jax import Array

from urbanjax.roadmap.graph import RoadGraph
from urbanjax.sim.scenery.footprints import apart, clearance
from urbanjax.sim.scenery.plots import KINDS, STYLES, Piece, Style, street
from urbanjax.sim.scenery.roadside import Roadside, roadsides
from urbanjax.types import as_arrays, pytree

ZONE = 250.0  # m of roadside for each zone of one style
AHEAD = 20.0  # m into a plot, where its style is told
SHORTEST = 15.0  # m, of the last plot of a side
GAPS = (0.5, 4.0, 9.0)  # m, from one plot to the next
# How prisms are altered: m that they move, factors of their size in plan and of their height, and m of height left.
MOVE, SHRINK, GROW, LEAST_HEIGHT = (2.0, 8.0), (0.4, 0.8), (0.5, 1.5), 0.3


@pytree
class Scenery:
    """K vertical prisms over oriented rectangles."""

    centre: Array  # [K, 2] m, in the map frame
    heading: Array  # [K] rad, of the length
    half: Array  # [K, 2] m, half the length and half the width
    bottom: Array  # [K] m above the ground
    top: Array  # [K] m above the ground
    reflectivity: Array  # [K] share of the light that comes back, 0 to 1
    valid: Array  # [K] bool


def furnish(graph: RoadGraph, seed: int = 0) -> Scenery:
    """Prisms beside all roads of a graph, none on or close to a lane: about one for 3 m of roadside (host side).

    Zones of different styles, in which both sides of the road are alike (see `plots`). Reproducible by the seed. Args:
    graph, the road graph; seed, of all that is drawn.
    """
    rng = np.random.default_rng(seed)
    sides = roadsides(graph)
    zones = _Zones(graph, sides, rng)
    drawn = [_along(side, zones, rng) for side in sides]
    pieces = [piece for some in drawn for piece in some]
    holder = np.concatenate([[p.holder for p in some] for some in drawn]).astype(int)
    first = np.repeat(np.cumsum([0, *map(len, drawn)])[:-1], [len(some) for some in drawn])
    holder = np.where(holder >= 0, holder + first, np.arange(len(pieces)))
    rows = _placed(sides, drawn, rng)
    margin = np.array([KINDS[p.kind].margin for p in pieces])
    rank = np.array([KINDS[pieces[k].kind].rank for k in holder])
    clear = clearance(graph, rows["centre"], heading=rows["heading"], half=rows["half"]) >= margin
    kept = apart(rows, rank, holder=holder, kept=clear & rows["valid"], spared=KINDS["wall"].rank)
    return as_arrays(Scenery(**{name: values[kept] for name, values in rows.items()}))


class _Zones:
    """Each place belongs to the nearest of random points on the roads, which has a style."""

    def __init__(self, graph: RoadGraph, sides: list[Roadside], rng: np.random.Generator) -> None:
        from scipy.spatial import cKDTree  # here: importing the package is not to wait for it

        road = np.asarray(graph.centre, float)[np.asarray(graph.valid)].reshape(-1, 2)
        n = min(max(round(sum(side.length for side in sides) / ZONE), 1), len(road))
        self.tree = cKDTree(rng.choice(road, n, replace=False))
        names = list(STYLES)
        order = [rng.permutation(names) for _ in range(-(-n // len(names)))]
        self.names = np.concatenate(order)[:n]  # all styles equally often

    def style(self, place: np.ndarray) -> Style:
        return STYLES[str(self.names[self.tree.query(place)[1]])]


def _along(side: Roadside, zones: _Zones, rng: np.random.Generator) -> list[Piece]:
    """Everything on one side: plot after plot."""
    pieces: list[Piece] = []
    at = 0.0
    while at < side.length:
        place, _ = side.at(np.array([at + AHEAD]), np.array([0.0]))
        style = zones.style(place[0])
        length = min(rng.uniform(*style.length), max(side.length - at, SHORTEST))
        style.plots[rng.choice(len(style.plots), p=style.weights)](rng, pieces, start=at, length=length)
        street(rng, pieces, start=at, length=length, style=style)
        at += length + rng.choice(GAPS)
    return pieces


def _placed(sides: list[Roadside], drawn: list[list[Piece]], rng: np.random.Generator) -> dict[str, Any]:
    """The fields of `Scenery`, from stations and offsets; not valid beyond the ends of a side."""
    centres, headings, within = [], [], []
    for side, some in zip(sides, drawn, strict=True):
        station = np.array([p.station for p in some])
        centre, heading = side.at(station, np.array([p.offset for p in some]))
        within.append((station >= 0) & (station <= side.length))
        centres.append(centre)
        headings.append(heading + np.array([p.turn for p in some]))
    pieces = [piece for some in drawn for piece in some]
    height = np.array([p.height for p in pieces])
    return {
        "centre": np.concatenate(centres),
        "heading": np.concatenate(headings),
        "half": np.array([p.half for p in pieces], float),
        "bottom": height[:, 0],
        "top": height[:, 1],
        "reflectivity": np.array([rng.uniform(*KINDS[p.kind].reflectivity) for p in pieces]),
        "valid": np.concatenate(within),
    }


def altered(surroundings: Scenery, share: float, *, seed: int = 0) -> Scenery:
    """The surroundings with that share of the prisms changed: a third each removed, moved and resized (host side).

    They move 2 to 8 m along their length, which follows the road, and only shrink in plan, so that they stay off it.
    Args: surroundings, what stands there; share, of its prisms; seed, of what is drawn.
    """
    rng = np.random.default_rng(seed)
    rows: dict[str, Any] = {
        field.name: np.array(getattr(surroundings, field.name)) for field in dataclasses.fields(surroundings)
    }
    standing = np.flatnonzero(rows["valid"])
    chosen = rng.permutation(standing)[: round(share * len(standing))]
    removed, moved, resized = np.array_split(chosen, 3)
    rows["valid"][removed] = False
    way = rng.uniform(*MOVE, len(moved)) * rng.choice([-1, 1], len(moved))
    heading = rows["heading"][moved]
    rows["centre"][moved] += way[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    rows["half"][resized] *= rng.uniform(*SHRINK, (len(resized), 2))
    top = rows["top"][resized] * rng.uniform(*GROW)
    rows["top"][resized] = np.maximum(rows["bottom"][resized] + LEAST_HEIGHT, top)
    return as_arrays(Scenery(**rows))
