"""Curves of the plane by arc length, as the frames of logs are found from."""

import numpy as np

from urbanjax.io.logs.record import LogError
from urbanjax.types import host_record

POINTS = 4000  # of a line between which feet are found


@host_record
class LogLine:
    """A curve at POINTS points of even spacing."""

    points: np.ndarray  # [POINTS, 2] m
    tangent: np.ndarray  # [POINTS, 2] unit
    behind: np.ndarray  # [POINTS] m, how far the line reaches back from each point along its tangent (not positive)
    ahead: np.ndarray  # [POINTS] m, and ahead
    vertices: np.ndarray  # [m, 2] m, as given; a closed line ends where it began
    station: np.ndarray  # [m] m
    closed: bool

    @staticmethod
    def of(vertices: np.ndarray, closed: bool, name: str) -> "LogLine":
        """The line through vertices [m, 2]. Raises LogError where they are not finite or all one point."""
        vertices = np.asarray(vertices, float)
        if vertices.ndim != 2 or vertices.shape[-1] != 2 or not np.isfinite(vertices).all():
            raise LogError(f"align: {name} {vertices.shape} is not [m, 2] and finite")
        vertices = np.concatenate([vertices, vertices[:1]]) if closed else vertices
        vertices = vertices[np.concatenate([[True], np.any(np.diff(vertices, axis=0) != 0, axis=-1)])]
        if len(vertices) < (4 if closed else 2):
            raise LogError(f"align: {name} has {len(vertices) - closed} different points, too few for a curve")
        step = np.hypot(*np.diff(vertices, axis=0).T)
        station = np.concatenate([[0.0], np.cumsum(step)])
        grid = np.linspace(0.0, station[-1], POINTS, endpoint=not closed)
        points = np.stack([np.interp(grid, station, axis) for axis in vertices.T], -1)
        around = (
            np.concatenate([points[-1:], points, points[:1]]) if closed else np.pad(points, ((1, 1), (0, 0)), "edge")
        )
        tangent = around[2:] - around[:-2]
        tangent = tangent / np.maximum(np.hypot(*tangent.T), 1e-300)[:, None]  # a point without direction gets none
        reach = np.full(POINTS, float(station[-1]) / POINTS)
        behind, ahead = -reach, reach.copy()
        if not closed:
            behind[0] = ahead[-1] = 0.0
        return LogLine(points, tangent, behind, ahead, vertices, station, closed)

    @property
    def length(self) -> float:
        """Of the curve, m."""
        return float(self.station[-1])

    @property
    def spacing(self) -> float:
        """Between two of the points, m."""
        return self.length / POINTS

    @property
    def extent(self) -> float:
        """Diagonal of the box around the curve, m."""
        return float(np.hypot(*np.ptp(self.vertices, axis=0)))

    def at(self, station: np.ndarray) -> np.ndarray:
        """Points [..., 2] at stations [...], m; beyond its end a closed line begins anew."""
        station = np.mod(station, self.length) if self.closed else station
        return np.stack([np.interp(station, self.station, axis) for axis in self.vertices.T], -1)


def along(line: LogLine, count: int) -> np.ndarray:
    """`count` stations [count] of even spacing, m.

    Args: line, the curve; count of stations.
    """
    return np.linspace(0.0, line.length, count)


def thinned(points: np.ndarray, least: float) -> np.ndarray:
    """The points [m, 2] that are at least `least` from the one kept before: noise at a standstill is no way.

    Args: points [m, 2] m; least [m].
    """
    return points[moved(points, least)]


def moved(points: np.ndarray, least: float) -> np.ndarray:
    """Which points [n] are at least `least` (m) from the last such point before; the first one is.

    Args: points [n, 2] m; least [m].
    """
    mask = np.zeros(len(points), bool)
    x0, y0 = np.inf, np.inf
    for k, (x, y) in enumerate(points.tolist()):
        if (x - x0) ** 2 + (y - y0) ** 2 >= least**2:
            mask[k] = True
            x0, y0 = x, y
    return mask
