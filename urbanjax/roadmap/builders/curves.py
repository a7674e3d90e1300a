"""Densely sampled planar curves with exact headings, from which lanes are laid out (host side, float64)."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from urbanjax.numerics import polynomial
from urbanjax.types import host_record

NODES = 5  # of the quadrature, per step
SAMPLES = 8  # at least so many segments of a part that is cut out
STRAIGHT_ON = 0.1  # rad, change of the heading below which two poses are joined by a cubic
PARALLEL = 0.05  # sine between two tangents below which they do not meet anywhere near
SHORTEST = 0.5  # m, of the tangents of an arc between two poses
FINE = 2, 32  # segments of a cubic: per step of its chord, and at least

Piece = tuple[float, float, float]  # length m, curvature at its start and at its end 1/m (linear in between)


@host_record
class Curve:
    """A curve sampled so finely that cubic interpolation between its samples is exact to micrometres."""

    station: np.ndarray  # [n] m
    position: np.ndarray  # [n, 2] m
    heading: np.ndarray  # [n] rad, unwrapped

    @property
    def length(self) -> float:
        """Arc length, in metres."""
        return float(self.station[-1])

    def end(self) -> tuple[float, float, float]:
        """x, y, heading of the last point."""
        return float(self.position[-1, 0]), float(self.position[-1, 1]), float(self.heading[-1])

    def at(self, station: np.ndarray) -> "Curve":
        """The curve at the given stations [m] (clipped to its ends)."""
        s = np.clip(station, 0.0, self.length)
        i = np.clip(np.searchsorted(self.station, s, side="right") - 1, 0, len(self.station) - 2)
        position = hermite(
            self.position, self.heading, step=np.diff(self.station)[i], index=i, along=s - self.station[i]
        )
        return Curve(np.asarray(station, float), position, np.interp(s, self.station, self.heading))

    def cut(self, start: float, end: float, step: float = 0.5) -> "Curve":
        """The part between two stations, its own stations starting from 0."""
        part = self.at(np.linspace(start, end, max(int(np.ceil((end - start) / step)), SAMPLES) + 1))
        return dataclasses.replace(part, station=part.station - start)

    def reversed(self) -> "Curve":
        """The same curve in the other direction."""
        return Curve(self.length - self.station[::-1], self.position[::-1], self.heading[::-1] + np.pi)

    def shifted(self, offset: float) -> "Curve":
        """The parallel curve `offset` metres to the left; its stations are its own arc length."""
        bend = np.gradient(self.heading, self.station)
        speed = 1.0 - offset * 0.5 * (bend[1:] + bend[:-1])
        station = np.concatenate([[0.0], np.cumsum(np.diff(self.station) * speed)])
        return Curve(station, self.position + offset * normal(self.heading), self.heading)


def normal(heading: np.ndarray) -> np.ndarray:
    """Unit vectors [n, 2] to the left of the headings [n]. Args: heading [n] rad."""
    return np.stack([-np.sin(heading), np.cos(heading)], -1)


def hermite(
    points: np.ndarray, heading: np.ndarray, *, step: np.ndarray, index: np.ndarray, along: np.ndarray
) -> np.ndarray:
    """Positions [m, 2] that lie `along` [m] metres into the segments `index` [m], each `step` [m] metres long.

    Args: points [n, 2] m; heading [n] rad, tangents there; step, index, along [m], one of each for every position.
    """
    h = step[:, None]
    t = along[:, None] / h
    tangent = np.stack([np.cos(heading), np.sin(heading)], -1)
    a, b = points[index], points[index + 1]
    begin, end, out, back = polynomial.hermite(t)
    return begin * a + end * b + h * (out * tangent[index] + back * tangent[index + 1])


def trace(pieces: Sequence[Piece], start: tuple[float, float, float] = (0.0, 0.0, 0.0), *, step: float = 0.25) -> Curve:
    """The curve through the pieces (lines, arcs, clothoids), from `start` = x, y, heading.

    Args: pieces, one after the other; start, x and y (m) and heading (rad); step m, largest distance between samples.
    """
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    x, y, heading = start
    stations, positions, headings = [np.zeros(1)], [np.array([[x, y]])], [np.array([heading])]
    for length, k0, k1 in pieces:
        if length <= 0:
            continue
        edges = np.linspace(0.0, length, int(np.ceil(length / step)) + 1)
        width = edges[1]
        inner = edges[:-1, None] + width * 0.5 * (nodes + 1)

        def angle(s, base=headings[-1][-1], k0=k0, rate=(k1 - k0) / length):
            return base + k0 * s + 0.5 * rate * s * s

        moves = 0.5 * width * np.stack([np.cos(angle(inner)) @ weights, np.sin(angle(inner)) @ weights], -1)
        stations.append(stations[-1][-1] + edges[1:])
        positions.append(positions[-1][-1] + np.cumsum(moves, 0))
        headings.append(angle(edges[1:]))
    return Curve(np.concatenate(stations), np.concatenate(positions), np.concatenate(headings))


def turn(angle: float, radius: float, *, transition: float = 0.0) -> list[Piece]:
    """Pieces that turn by `angle` [rad, left positive] on `radius` [m], with clothoids of length `transition` [m].

    Args: angle rad; radius m, of the arc; transition m, shortened where the bend is.
    """
    k = np.sign(angle) / radius
    ramp = min(transition, abs(angle) * radius)
    arc = abs(angle) * radius - ramp
    return [(ramp, 0.0, k * 1.0), (arc, k, k), (ramp, k, 0.0)]


def connect(start: tuple[float, float, float], end: tuple[float, float, float], *, step: float = 0.25) -> Curve:
    """A smooth curve between two poses (x, y, heading).

    Line, arc, line where the tangents meet ahead of the start and behind the end; otherwise a cubic.
    Args: start and end, x and y (m) and heading (rad); step m, largest distance between samples.
    """
    a, b = np.array(start[:2]), np.array(end[:2])
    angle = (end[2] - start[2] + np.pi) % (2 * np.pi) - np.pi
    ta, tb = (np.array([np.cos(h), np.sin(h)]) for h in (start[2], end[2]))
    cross = ta[0] * tb[1] - ta[1] * tb[0]
    if abs(angle) > STRAIGHT_ON and abs(cross) > PARALLEL:
        d = b - a
        before = (d[0] * tb[1] - d[1] * tb[0]) / cross
        after = (ta[0] * d[1] - ta[1] * d[0]) / cross
        if before > SHORTEST and after > SHORTEST:
            reach = min(before, after)
            bend = turn(angle, reach / np.tan(abs(angle) / 2))
            return trace([(before - reach, 0.0, 0.0), *bend, (after - reach, 0.0, 0.0)], start, step=step)
    return _cubic(a, b, ta, tb, start[2], step)


def _cubic(a, b, ta, tb, heading: float, step: float) -> Curve:
    """The cubic from a to b with unit tangents ta and tb, by arc length."""
    size = np.linalg.norm(b - a)
    t = np.linspace(0.0, 1.0, max(int(np.ceil(size / step)) * FINE[0], FINE[1]) + 1)[:, None]
    position, slope = (
        begin * a + end * b + size * (out * ta + back * tb)
        for begin, end, out, back in (polynomial.hermite(t), polynomial.hermite_slope(t))
    )
    angle = np.unwrap(np.arctan2(slope[:, 1], slope[:, 0]))
    angle += 2 * np.pi * np.round((heading - angle[0]) / (2 * np.pi))
    speed = np.linalg.norm(slope, axis=-1)
    station = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(t[:, 0]))])
    return Curve(station, position, angle)
