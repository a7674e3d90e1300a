"""What stands on the plots along a road, drawn at random (host side): offsets are from the lanes' border, in metres.

Four styles of district: `centre` (rows of houses, parked cars), `suburb` (houses in gardens), `works` (long bare walls,
where little tells how far along the road one is, and car parks), and `green` (trees).

Bare numbers in the functions below are the drawn sizes: m for lengths, offsets and heights, rad for angles, and shares
from 0 to 1 for what not every plot has. They are guesses at what towns look like; nothing else rests on one of them.
"""

from typing import NamedTuple, Protocol

import numpy as np


class Kind(NamedTuple):
    """A kind of thing: the first in the table keeps its place when two stand in each other's way."""

    rank: int
    margin: float  # m, that it keeps from every lane
    reflectivity: tuple[float, float]


KINDS = {
    "building": Kind(0, 3.0, (0.2, 0.6)),
    "wall": Kind(1, 1.5, (0.2, 0.5)),
    "pole": Kind(2, 1.5, (0.3, 0.7)),
    "sign": Kind(3, 1.5, (0.8, 1.0)),
    "tree": Kind(4, 1.5, (0.15, 0.4)),
    "car": Kind(5, 1.5, (0.1, 0.9)),
    "box": Kind(6, 1.5, (0.2, 0.7)),
}


class Piece(NamedTuple):
    """A prism beside a road, at a station and an offset to its centre."""

    kind: str
    station: float
    offset: float
    half: tuple[float, float]  # along the road and across it
    height: tuple[float, float]  # bottom and top
    turn: float = 0.0  # rad, from the road's heading
    holder: int = -1  # piece of the same list that it is fixed to: it stands in nobody's way there, and falls with it


class Draw(Protocol):
    """A kind of plot."""

    def __call__(self, rng: np.random.Generator, pieces: list[Piece], *, start: float, length: float) -> None:
        """Adds to `pieces` what stands on `length` m of roadside from station `start` (m) on."""


def house(
    rng: np.random.Generator, pieces: list[Piece], *, start: float, width: float, front: float, top: float
) -> None:
    """One building, often with balconies or bays on its face.

    Args: rng, the source of chance; pieces, the list that it is added to; start [m], the station where it begins; width
    [m], along the road; front [m], offset of its face; top [m], its height.
    """
    depth = rng.uniform(8.0, 14.0)
    turn = rng.normal(0.0, 0.02 if rng.random() < 0.8 else 1.2 / width)
    middle = start + width / 2
    me = len(pieces)
    pieces.append(Piece("building", middle, front + depth / 2, (width / 2, depth / 2), (0.0, top), turn))
    for _ in range(rng.integers(0, 3)):
        reach, half = rng.uniform(0.3, 0.7), rng.uniform(0.6, 1.8)
        at = middle + rng.uniform(-0.8, 0.8) * (width / 2 - half)
        bottom = rng.choice([0.0, 2.8, 3.2])
        pieces.append(Piece("box", at, front - reach, (half, reach), (bottom, bottom + 2.4), turn, me))


def tree(rng: np.random.Generator, pieces: list[Piece], *, station: float, offset: float) -> None:
    """A trunk, and a crown on most.

    Args: rng, the source of chance; pieces, the list that it is added to; station and offset [m].
    """
    trunk, fork = rng.uniform(0.1, 0.25), rng.uniform(2.2, 3.2)
    me = len(pieces)
    pieces.append(Piece("tree", station, offset, (trunk, trunk), (0.0, fork), rng.uniform(0, 1.5)))
    if rng.random() < 0.8:
        crown = rng.uniform(0.8, min(2.2, max(offset - 1.7, 0.9)))
        shape = (crown, crown * rng.uniform(0.8, 1.0))
        pieces.append(Piece("tree", station, offset, shape, (fork, fork + rng.uniform(2.0, 5.0)), holder=me))


def kerb_cars(rng: np.random.Generator, pieces: list[Piece], *, start: float, length: float) -> None:
    """Cars parked along the kerb, with gaps.

    Args: rng, the source of chance; pieces, the list that it is added to; start [m], the station where it begins;
    length [m].
    """
    for at in np.arange(start + 3.0, start + length - 3.0, 6.2):
        if rng.random() < 0.65:
            half = (rng.uniform(1.9, 2.5), rng.uniform(0.82, 0.98))
            top = rng.choice([1.45, 1.7, 2.3], p=[0.65, 0.25, 0.1])
            pieces.append(Piece("car", at + rng.normal(0, 0.25), rng.normal(2.8, 0.06), half, (0.2, top)))


def row(rng: np.random.Generator, pieces: list[Piece], *, start: float, length: float) -> None:
    """Houses side by side at the pavement, each with a front of its own.

    Args: rng, the source of chance; pieces, the list that it is added to; start [m], the station where it begins;
    length [m].
    """
    front = rng.uniform(5.2, 8.0)
    at = start
    while at < start + length - 8.0:
        width = min(rng.uniform(8.0, 22.0), start + length - at)
        house(rng, pieces, start=at, width=width, front=front + rng.uniform(-0.8, 1.4), top=rng.uniform(6.0, 20.0))
        if rng.random() < 0.3:
            wide, deep, back = rng.uniform(8.0, 14.0), rng.uniform(7.0, 12.0), rng.uniform(24.0, 30.0)
            height = (0.0, rng.uniform(15.0, 40.0))
            pieces.append(Piece("building", at + width / 2, front + back + deep, (wide, deep), height))
        at += width + (0.05 if rng.random() < 0.45 else rng.uniform(1.0, 6.0))
    if rng.random() < 0.6:
        kerb_cars(rng, pieces, start=start, length=length)


def gardens(rng: np.random.Generator, pieces: list[Piece], *, start: float, length: float) -> None:
    """Small houses behind hedges and fences with gates.

    Args: rng, the source of chance; pieces, the list that it is added to; start [m], the station where it begins;
    length [m].
    """
    at = start
    while at < start + length - 12.0:
        width, gap = rng.uniform(9.0, 15.0), rng.uniform(4.0, 12.0)
        front = rng.uniform(8.0, 14.0)
        house(rng, pieces, start=at + gap / 2, width=width, front=front, top=rng.uniform(4.0, 8.5))
        gate, hedge = rng.uniform(3.0, 5.0), rng.uniform(4.2, 4.8)
        half = ((width + gap - gate) / 2, rng.uniform(0.1, 0.4))
        pieces.append(Piece("wall", at + half[0], hedge, half, (0.0, rng.uniform(0.8, 1.9)), rng.normal(0, 0.005)))
        if rng.random() < 0.6:
            tree(rng, pieces, station=at + rng.uniform(0.0, width), offset=rng.uniform(6.0, front - 1.0))
        if rng.random() < 0.4:
            turn = np.pi / 2 + rng.normal(0, 0.1)
            pieces.append(Piece("car", at + width + gap - gate / 2, 8.0, (2.2, 0.9), (0.2, 1.5), turn))
        at += width + gap


def wall(pieces: list[Piece], start: float, *, length: float, offset: float, half: float, top: float) -> None:
    """A wall in straight parts, which follows the road.

    Args: pieces, the list that it is added to; start [m], the station where it begins; length [m]; offset [m]; half
    [m], half its thickness; top [m], its height.
    """
    n = int(np.ceil(length / 8.0))
    part = length / n
    for at in start + part * (np.arange(n) + 0.5):
        pieces.append(Piece("wall", at, offset, (part / 2 + 0.02, half), (0.0, top)))


def bare_wall(rng: np.random.Generator, pieces: list[Piece], *, start: float, length: float) -> None:
    """A long smooth wall, which hides nearly all that is behind it.

    Args: rng, the source of chance; pieces, the list that it is added to; start [m], the station where it begins;
    length [m].
    """
    offset = rng.uniform(3.6, 5.0)
    wall(pieces, start, length=length, offset=offset, half=0.15, top=rng.uniform(2.6, 4.0))
    if rng.random() < 0.5:
        width = length * rng.uniform(0.2, 0.5)
        house(
            rng,
            pieces,
            start=start + rng.uniform(0, length - width),
            width=width,
            front=offset + 8.0,
            top=rng.uniform(5.0, 9.0),
        )


def car_park(rng: np.random.Generator, pieces: list[Piece], *, start: float, length: float) -> None:
    """Cars across, a fence, and a hall far behind.

    Args: rng, the source of chance; pieces, the list that it is added to; start [m], the station where it begins;
    length [m].
    """
    for at in np.arange(start + 2.0, start + length - 2.0, 2.7):
        if rng.random() < 0.6:
            turn = np.pi / 2 + rng.normal(0, 0.03)
            half = (rng.uniform(1.9, 2.4), rng.uniform(0.82, 0.98))
            pieces.append(Piece("car", at, rng.normal(7.5, 0.2), half, (0.2, rng.uniform(1.4, 1.9)), turn))
    wall(pieces, start + 1.0, length=length - 2.0, offset=11.5, half=0.08, top=1.2)
    width = min(length - 4.0, rng.uniform(30.0, 60.0))
    house(rng, pieces, start=start + 2.0, width=width, front=rng.uniform(18.0, 26.0), top=rng.uniform(6.0, 11.0))


def grove(rng: np.random.Generator, pieces: list[Piece], *, start: float, length: float) -> None:
    """Trees in no order, here and there a kiosk.

    Args: rng, the source of chance; pieces, the list that it is added to; start [m], the station where it begins;
    length [m].
    """
    for at in np.arange(start, start + length, 4.0):
        if rng.random() < 0.7:
            tree(rng, pieces, station=at + rng.uniform(0, 3.0), offset=3.4 + rng.exponential(6.0))
    if rng.random() < 0.5:
        half = (rng.uniform(1.2, 2.5), rng.uniform(1.0, 1.6))
        pieces.append(Piece("wall", start + length / 2, 5.5, half, (0.0, rng.uniform(2.2, 3.0)), rng.normal(0, 0.1)))


class Style(NamedTuple):
    """A style of district."""

    plots: tuple[Draw, ...]
    weights: tuple[float, ...]
    length: tuple[float, float]  # m, of one plot
    lamps: tuple[float, float]  # m, from one to the next
    clutter: float  # m, mean distance between boxes, bins and signs


STYLES = {
    "centre": Style((row, grove, car_park), (0.8, 0.12, 0.08), (40.0, 110.0), (24.0, 34.0), 14.0),
    "suburb": Style((gardens, grove, row), (0.75, 0.15, 0.1), (40.0, 90.0), (28.0, 40.0), 25.0),
    "works": Style((bare_wall, car_park, row), (0.7, 0.2, 0.1), (50.0, 130.0), (45.0, 70.0), 60.0),
    "green": Style((grove, gardens), (0.75, 0.25), (40.0, 90.0), (30.0, 45.0), 35.0),
}


def street(rng: np.random.Generator, pieces: list[Piece], *, start: float, length: float, style: Style) -> None:
    """Lamps, signs, bins and boxes on the pavement.

    Args: rng, the source of chance; pieces, the list that it is added to; start [m], the station where it begins;
    length [m]; style, of the district.
    """
    at = start + rng.uniform(0, style.lamps[0])
    while at < start + length:
        pole = rng.uniform(0.07, 0.12)
        pieces.append(Piece("pole", at, rng.uniform(1.8, 2.3), (pole, pole), (0.0, rng.uniform(5.0, 9.0))))
        at += rng.uniform(*style.lamps)
    for at in start + length * rng.random(rng.poisson(length / style.clutter)):
        offset = rng.uniform(1.9, 2.6) if rng.random() < 0.5 else rng.uniform(3.8, 4.4)
        if rng.random() < 0.4:
            me, half = len(pieces), rng.uniform(0.3, 0.45)
            pieces.append(Piece("sign", at, offset, (0.06, 0.06), (0.0, 2.1)))
            turn = rng.normal(0, 0.1)
            pieces.append(Piece("sign", at, offset, (0.03, half), (2.1, 2.1 + 2 * half), turn, me))
        else:
            half = (rng.uniform(0.12, 0.6), rng.uniform(0.12, 0.3))
            pieces.append(Piece("box", at, offset, half, (0.0, rng.uniform(0.7, 1.5)), rng.normal(0, 0.1)))
