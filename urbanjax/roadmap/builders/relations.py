"""Geometric relations between links: station maps of neighbours, opposite lanes, conflicts (host side, float64)."""

import numpy as np

from urbanjax.roadmap.builders.curves import hermite

CHUNK = 256  # pairs at a time: bounds the memory of the all-to-all comparison
OPPOSED = np.cos(np.radians(150.0))  # headings further apart than this run against each other
ADJACENT = 0.75  # times the summed widths: lateral distance up to which opposed lanes are related
COINCIDE = 0.1  # times the summed widths: mean lateral distance below which opposed lanes are on the same ground
OVERLAP = 0.35  # times the summed widths: distance below which two lanes conflict


def project(points: np.ndarray, line: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Nearest places of points [..., M, 2] on polylines [..., P, 2] with the same leading axes.

    Returns the place as a fractional vertex index, the distance, the signed lateral offset (left positive) and
    whether the foot lies inside the polyline, each [..., M].
    """
    a, d = line[..., None, :-1, :], np.diff(line, axis=-2)[..., None, :, :]
    r = points[..., :, None, :] - a
    square = np.maximum((d * d).sum(-1), 1e-12)
    free = (r * d).sum(-1) / square
    t = np.clip(free, 0.0, 1.0)
    away = r - t[..., None] * d
    gap = (away * away).sum(-1)
    k = gap.argmin(-1)[..., None]

    def pick(x):
        return np.take_along_axis(x, k, -1)[..., 0]

    k0, free = k[..., 0], pick(free)
    last = line.shape[-2] - 2
    inside = ~(((k0 == 0) & (free < -1e-9)) | ((k0 == last) & (free > 1 + 1e-9)))
    cross = d[..., 0] * r[..., 1] - d[..., 1] * r[..., 0]
    return k0 + pick(t), np.sqrt(pick(gap)), pick(cross / np.sqrt(square)), inside


def neighbour_stations(centre: np.ndarray, heading: np.ndarray, length: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Station [L, P] on link other[l] at the foot of the perpendicular from each point of link l."""
    last = centre.shape[1] - 1
    step = np.broadcast_to((length[other] / last)[:, None], centre.shape[:2]).ravel()
    line, angle = centre[other].reshape(-1, 2), heading[other].ravel()
    first = np.repeat(np.arange(len(other)) * (last + 1), last + 1)
    points = centre.reshape(-1, 2)
    where = project(centre, centre[other])[0].ravel()
    for _ in range(4):  # the foot on the polyline starts a Newton iteration on the smooth curve through its points
        k = np.minimum(where.astype(int), last - 1)
        f, i = where - k, first + k
        turned = angle[i + 1] - angle[i]
        h = angle[i] + f * turned
        away = points - hermite(line, angle, step, i, f * step)
        along = away[:, 0] * np.cos(h) + away[:, 1] * np.sin(h)
        aside = away[:, 1] * np.cos(h) - away[:, 0] * np.sin(h)
        where = np.clip(where + along / (step * np.maximum(1 - aside * turned / step, 0.2)), 0.0, last)
    return (where * step).reshape(centre.shape[:2])


def _near_pairs(centre: np.ndarray, margin: np.ndarray) -> np.ndarray:
    """Pairs i < j [n, 2] whose bounding circles come closer than the sum of their margins."""
    middle = 0.5 * (centre.min(1) + centre.max(1))
    radius = np.linalg.norm(centre - middle[:, None], axis=-1).max(1) + margin
    gap = np.linalg.norm(middle[:, None] - middle[None], axis=-1) - radius[:, None] - radius[None]
    return np.argwhere(np.triu(gap < 0, 1))


def opposites(
    centre: np.ndarray, heading: np.ndarray, width: np.ndarray, length: np.ndarray
) -> list[list[tuple[int, float]]]:
    """For each link the links in the other direction on the same or the adjacent ground, with their mean offset.

    Related where at least 10 m or half of the shorter one lie side by side or coincide; those that cross, like two
    turns in a junction, are a conflict. Offsets in metres, left positive.
    """
    out: list[list[tuple[int, float]]] = [[] for _ in centre]
    pairs = _near_pairs(centre, width)
    for block in np.array_split(pairs, max(1, -(-len(pairs) // CHUNK))):
        if not len(block):
            continue
        reach = ADJACENT * width[block].sum(-1)[:, None]
        beside, offsets = [], []
        for i, j in (block.T, block.T[::-1]):
            where, _, offset, inside = project(centre[i], centre[j])
            there = heading[j][np.arange(len(j))[:, None], np.round(where).astype(int)]
            match = inside & (np.abs(offset) < reach) & (np.cos(heading[i] - there) < OPPOSED)
            beside.append(match.mean(-1) * length[i])
            # Seen from i, a point left of the oncoming j has j on its left as well.
            offsets.append((match * offset).sum(-1) / np.maximum(match.sum(-1), 1))
        enough = np.minimum(10.0, 0.5 * length[block].min(-1))
        coincide = np.abs(offsets[0]) < COINCIDE * width[block].sum(-1)
        apart = coincide | ~_crossing(centre[block[:, 0]], centre[block[:, 1]])
        for (i, j), shared, a, b in zip(block, apart & (np.minimum(*beside) >= enough), *offsets, strict=True):
            if shared:
                out[i].append((int(j), float(a)))
                out[j].append((int(i), float(b)))
    return out


def conflicts(centre: np.ndarray, width: np.ndarray, related: set[tuple[int, int]]) -> list[list[int]]:
    """For each link the links that cross it or merge with it, apart from the pairs already related otherwise."""
    out: list[list[int]] = [[] for _ in centre]
    pairs = np.array(
        [(i, j) for i, j in _near_pairs(centre, width) if (i, j) not in related and (j, i) not in related], int
    ).reshape(-1, 2)
    for block in np.array_split(pairs, max(1, -(-len(pairs) // CHUNK))):
        if not len(block):
            continue
        a, b = centre[block[:, 0]], centre[block[:, 1]]
        nearest = np.minimum(project(a, b)[1].min(-1), project(b, a)[1].min(-1))
        meet = (nearest < OVERLAP * width[block].sum(-1)) | _crossing(a, b)
        for i, j in block[meet]:
            out[i].append(int(j))
            out[j].append(int(i))
    return out


def _crossing(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Whether the polylines a, b [n, P, 2] intersect, [n]."""

    def side(p, q, r):
        return (q[..., 0] - p[..., 0]) * (r[..., 1] - p[..., 1]) - (q[..., 1] - p[..., 1]) * (r[..., 0] - p[..., 0])

    a0, a1 = a[:, :-1, None], a[:, 1:, None]
    b0, b1 = b[:, None, :-1], b[:, None, 1:]
    apart = (side(a0, a1, b0) * side(a0, a1, b1) < 0) & (side(b0, b1, a0) * side(b0, b1, a1) < 0)
    return np.any(apart, axis=(1, 2))
