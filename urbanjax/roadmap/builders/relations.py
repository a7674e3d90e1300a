"""Geometric relations between links: station maps of neighbours, opposite lanes, conflicts (host side, float64)."""

import numpy as np

from urbanjax.geometry.frenet import MIN_SCALE
from urbanjax.roadmap.builders.curves import hermite
from urbanjax.types import RoadError, host_record

CHUNK = 256  # links at a time: bounds the memory of the all-to-all comparison
STEPS = 4  # of Newton's method from the polyline to the curve
SPACING = 2.0  # m, between the points by which links are compared
COARSE = 32  # segments of a link on which the place beside a point is sought first
PIECE = 8  # segments of a link that are compared with those of another at once
MOST_PIECES, MOST_PAIRS = 100_000, 4_000_000  # of pieces
SAMPLED = 0.9  # of a length measured by such points may be missing
OPPOSED = np.cos(np.radians(150.0))  # headings further apart than this run against each other
ADJACENT = 0.75  # times the summed widths: lateral distance up to which opposed lanes are related
BESIDE = 10.0, 0.5  # m, or times the shorter link, whichever is less: how much of it opposed lanes run side by side
COINCIDE = 0.1  # times the summed widths: mean lateral distance below which opposed lanes are on the same ground
OVERLAP = 0.35  # times the summed widths: distance below which two lanes conflict


def project(points: np.ndarray, line: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Nearest places of points [..., M, 2] on polylines [..., P, 2] with the same leading axes.

    Returns the place as a fractional vertex index, the distance, the signed lateral offset (left positive) and
    whether the foot lies inside the polyline, each [..., M].
    Args: points m; line m.
    """
    step = np.diff(line, axis=-2)[..., None, :, :]
    dx, dy = step[..., 0], step[..., 1]
    rx, ry = (points[..., :, None, k] - line[..., None, :-1, k] for k in range(2))
    square = np.maximum(dx * dx + dy * dy, 1e-12)  # m^2, keeps repeated points from dividing by 0
    free = (rx * dx + ry * dy) / square
    t = np.clip(free, 0.0, 1.0)
    gap = (rx - t * dx) ** 2 + (ry - t * dy) ** 2
    k = gap.argmin(-1)[..., None]

    def pick(x):
        return np.take_along_axis(x, k, -1)[..., 0]

    k0, free = k[..., 0], pick(free)
    last = line.shape[-2] - 2
    # A foot that misses an end by rounding alone is inside.
    inside = ~(((k0 == 0) & (free < -1e-9)) | ((k0 == last) & (free > 1 + 1e-9)))
    cross = dx * ry - dy * rx
    return k0 + pick(t), np.sqrt(pick(gap)), pick(cross / np.sqrt(square)), inside


def neighbour_stations(centre: np.ndarray, heading: np.ndarray, *, length: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Station [L, P] on link other[l] at the foot of the perpendicular from each point of link l; its own for l.

    Args: centre [L, P, 2] m; heading [L, P] rad; length [L] m; other [L], a link beside each.
    """
    out = length[:, None] * np.linspace(0.0, 1.0, centre.shape[1])
    beside = np.flatnonzero(other != np.arange(len(other)))
    for part in np.array_split(beside, -(-len(beside) // CHUNK)) if len(beside) else []:
        out[part] = _stations(centre[part], centre[other[part]], heading[other[part]], length[other[part]])
    return out


def _stations(points: np.ndarray, line: np.ndarray, angle: np.ndarray, length: np.ndarray) -> np.ndarray:
    """Station [n, P] of the foot of the perpendicular from each point [n, P, 2] on the line beside it."""
    shape, last = points.shape[:2], points.shape[1] - 1
    step = np.broadcast_to((length / last)[:, None], shape).ravel()
    knot = np.unique(np.linspace(0, last, COARSE + 1).astype(int))
    where = np.interp(project(points, line[:, knot])[0], np.arange(len(knot)), knot).ravel()
    line, angle, points = line.reshape(-1, 2), angle.ravel(), points.reshape(-1, 2)
    first = np.repeat(np.arange(shape[0]) * (last + 1), last + 1)
    for _ in range(STEPS):  # the foot on the polyline starts a Newton iteration on the smooth curve through its points
        k = np.minimum(where.astype(int), last - 1)
        f, i = where - k, first + k
        turned = angle[i + 1] - angle[i]
        h = angle[i] + f * turned
        away = points - hermite(line, angle, step=step, index=i, along=f * step)
        along = away[:, 0] * np.cos(h) + away[:, 1] * np.sin(h)
        aside = away[:, 1] * np.cos(h) - away[:, 0] * np.sin(h)
        where = np.clip(where + along / (step * np.maximum(1 - aside * turned / step, MIN_SCALE)), 0.0, last)
    return (where * step).reshape(shape)


@host_record
class Pieces:
    """Links cut into N pieces of equally many segments, and the ordered pairs of pieces that come near each other."""

    link: np.ndarray  # [N] int, the link of each
    point: np.ndarray  # [N, M, 2] m
    heading: np.ndarray  # [N, M] rad
    first: np.ndarray  # [N] bool, begins its link
    last: np.ndarray  # [N] bool, ends it
    pair: np.ndarray  # [n, 2] int, pieces a and b of different links, sorted by link of a, link of b, a


def pieces(centre: np.ndarray, heading: np.ndarray, *, width: np.ndarray, length: np.ndarray) -> Pieces:
    """The pieces of links [L, P], with the pairs that come closer than the sum of their widths.

    Raises RoadError where there are too many to be compared, as of lanes that lie on top of each other.
    Args: centre [L, P, 2] m; heading [L, P] rad; width [L] m; length [L] m.
    """
    from scipy.spatial import cKDTree  # here: importing the package is not to wait for it

    count = np.maximum(np.ceil(length / (SPACING * PIECE)), 1).astype(int)
    if count.sum() > MOST_PIECES:
        raise RoadError(f"the lanes are {length.sum() / 1000:.0f} km long, too much for one map: cut it")
    link = np.repeat(np.arange(len(centre)), count)
    number = np.arange(len(link)) - np.repeat(np.cumsum(count) - count, count)
    share = (number[:, None] + np.linspace(0.0, 1.0, PIECE + 1)) / count[link][:, None]
    where = share * (centre.shape[1] - 1)
    k = np.minimum(where.astype(int), centre.shape[1] - 2)
    f = where - k
    point = centre[link[:, None], k] * (1 - f[..., None]) + centre[link[:, None], k + 1] * f[..., None]
    angle = heading[link[:, None], k] * (1 - f) + heading[link[:, None], k + 1] * f
    middle = 0.5 * (point.min(1) + point.max(1))
    reach = np.linalg.norm(point - middle[:, None], axis=-1).max(1) + width[link]
    tree = cKDTree(middle)
    if tree.count_neighbors(tree, 2 * reach.max()) > 2 * MOST_PAIRS + len(link):
        raise RoadError("too many lanes lie on top of each other to be told apart: cut the map")
    pair = tree.query_pairs(2 * reach.max(), output_type="ndarray")
    i, j = pair.T
    near = np.linalg.norm(middle[i] - middle[j], axis=-1) < reach[i] + reach[j]
    pair = pair[near & (link[i] != link[j])]
    pair = np.concatenate([pair, pair[:, ::-1]])
    pair = pair[np.lexsort((pair[:, 1], pair[:, 0], link[pair[:, 1]], link[pair[:, 0]]))]
    return Pieces(link, point, angle, number == 0, number == count[link] - 1, pair)


def _starts(*keys: np.ndarray) -> np.ndarray:
    """Where runs of equal keys begin."""
    if not len(keys[0]):
        return np.zeros(0, int)
    return np.flatnonzero(np.concatenate([[True], np.any([np.diff(key) != 0 for key in keys], axis=0)]))


@host_record
class Meetings:
    """For each ordered pair of links that come near each other, n of them, how they lie."""

    link: np.ndarray  # [n, 2] int, sorted
    distance: np.ndarray  # [n] m, least from a point of the first to the second
    crosses: np.ndarray  # [n] bool, the centre lines intersect
    beside: np.ndarray  # [n] m of the first that the second runs along in the other direction
    offset: np.ndarray  # [n] m, mean lateral offset of the second there, left positive


def meetings(parts: Pieces, width: np.ndarray, *, length: np.ndarray) -> Meetings:
    """How the links of all near pairs lie to each other.

    Args: parts, the pieces of all links; width [L] m; length [L] m.
    """
    a, b = parts.pair.T
    gap = np.empty((len(a), PIECE + 1))
    offset, opposed, inside = np.empty_like(gap), np.empty(gap.shape, bool), np.empty(gap.shape, bool)
    crosses = np.zeros(len(a), bool)
    for block in np.array_split(np.arange(len(a)), -(-len(a) // (16 * CHUNK))) if len(a) else []:
        i, j = a[block], b[block]
        where, gap[block], offset[block], within = project(parts.point[i], parts.point[j])
        there = parts.heading[j][np.arange(len(j))[:, None], np.round(where).astype(int)]
        opposed[block] = np.cos(parts.heading[i] - there) < OPPOSED
        # A foot beyond the end of a piece lies on the next piece, unless the link ends there.
        beyond = ~within & np.where(where <= 0, parts.first[j][:, None], parts.last[j][:, None])
        inside[block] = ~beyond
        # Where two pieces cross, a corner of one lies within half a segment of the other.
        close = gap[block].min(1) < SPACING
        crosses[block[close]] = crossing(parts.point[i[close]], parts.point[j[close]])
    pair = parts.link[parts.pair]
    run = _starts(pair[:, 0], pair[:, 1], a)  # one piece of the first link, all near ones of the second
    pair, of_run = pair[run], np.repeat(np.arange(len(run)), np.diff(np.append(run, len(a))))
    least = np.minimum.reduceat(gap, run, axis=0) if len(run) else gap
    reach = ADJACENT * width[parts.link[parts.pair]].sum(-1)[:, None]
    match = (gap == least[of_run]) & inside & opposed & (np.abs(offset) < reach)
    seen = np.logical_or.reduceat(match, run, axis=0) if len(run) else match
    # Where two pieces are equally near, at their common end, both say the same.
    both = np.maximum(np.add.reduceat(match, run, axis=0, dtype=float) if len(run) else match, 1)
    sums = (np.add.reduceat(match * offset, run, axis=0) if len(run) else gap) / both
    group = _starts(*pair.T)
    if not len(group):
        nothing = np.zeros(0)
        return Meetings(np.zeros((0, 2), int), nothing, nothing > 0, nothing, nothing)
    count = np.bincount(parts.link, minlength=len(length))
    points = np.add.reduceat(seen.sum(1), group)
    share = np.add.reduceat(seen @ (np.r_[0.5, np.ones(PIECE - 1), 0.5] / PIECE), group)
    first = pair[group, 0]
    return Meetings(
        link=pair[group],
        distance=np.minimum.reduceat(least.min(1), group),
        crosses=np.logical_or.reduceat(np.logical_or.reduceat(crosses, run), group),
        beside=share * length[first] / count[first],
        offset=np.add.reduceat(sums.sum(1), group) / np.maximum(points, 1),
    )


def opposites(found: Meetings, width: np.ndarray, *, length: np.ndarray) -> list[list[tuple[int, float]]]:
    """For each link the links in the other direction on the same or the adjacent ground, with their mean offset.

    Related where at least 10 m or half of the shorter one lie side by side or coincide; those that cross, like two
    turns in a junction, are a conflict. Offsets in metres, left positive.
    Args: found, how near links lie; width [L] m; length [L] m.
    """
    out: list[list[tuple[int, float]]] = [[] for _ in length]
    back = _mirrored(found)
    summed = width[found.link].sum(-1)
    enough = np.minimum(BESIDE[0], BESIDE[1] * length[found.link].min(-1)) * SAMPLED
    apart = (np.abs(found.offset) < COINCIDE * summed) | ~(found.crosses | found.crosses[back])
    shared = apart & apart[back] & (np.minimum(found.beside, found.beside[back]) >= enough)
    for (i, j), offset in zip(found.link[shared], found.offset[shared], strict=True):
        out[i].append((int(j), float(offset)))
    return out


def conflicts(found: Meetings, width: np.ndarray, *, related: set[tuple[int, int]]) -> list[list[int]]:
    """For each link the links that cross it or merge with it, apart from the pairs already related otherwise.

    Args: found, how near links lie; width [L] m; related, pairs of links that are no conflict.
    """
    out: list[list[int]] = [[] for _ in width]
    back = _mirrored(found)
    nearest = np.minimum(found.distance, found.distance[back])
    meet = (nearest < OVERLAP * width[found.link].sum(-1)) | found.crosses | found.crosses[back]
    for i, j in found.link[meet].tolist():
        if (i, j) not in related and (j, i) not in related:
            out[i].append(j)
    return out


def _mirrored(found: Meetings) -> np.ndarray:
    """Row of (j, i) for each row (i, j)."""
    return np.lexsort((found.link[:, 0], found.link[:, 1]))


def crossing(a: np.ndarray, b: np.ndarray, *, least_angle: float = 0.0) -> np.ndarray:
    """Whether the polylines a, b [n, P, 2] intersect, [n], at an angle of at least `least_angle` [rad].

    Args: a, b m; least_angle rad (0: any).
    """

    def side(p, q, r):
        return (q[..., 0] - p[..., 0]) * (r[..., 1] - p[..., 1]) - (q[..., 1] - p[..., 1]) * (r[..., 0] - p[..., 0])

    a0, a1 = a[:, :-1, None], a[:, 1:, None]
    b0, b1 = b[:, None, :-1], b[:, None, 1:]
    apart = (side(a0, a1, b0) * side(a0, a1, b1) < 0) & (side(b0, b1, a0) * side(b0, b1, a1) < 0)
    if least_angle > 0:
        along, across = a1 - a0, b1 - b0
        sine = np.abs(along[..., 0] * across[..., 1] - along[..., 1] * across[..., 0])
        apart &= sine > np.sin(least_angle) * np.linalg.norm(along, axis=-1) * np.linalg.norm(across, axis=-1)
    return np.any(apart, axis=(1, 2))
