"""The frame of logs found from a line that they follow: closest points from many starts, and how sure it is."""

import itertools
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from urbanjax.io.logs.closest import feet, refined
from urbanjax.io.logs.frame import Frame, apart, fit, frame, mirrors
from urbanjax.io.logs.line import LogLine, along, thinned
from urbanjax.io.logs.record import LogError
from urbanjax.types import host_record, pytree, static

SHAPE = 64  # points of a path that is held against the line
OFFSETS = 180  # places of the line at which it may begin
SLIDES = 12  # places of the path at which the line may begin, where the path is the longer one
SOON = 12  # iterations after which starts that lead to one frame are one
CANDIDATES = 20  # times the starts: best fits of one guess that are sifted for unlike frames
FEWEST = 8  # points of a path
LONGER = 1.01  # times the window: a path so long slides along the line
CLOSE = 1e-4  # of the extent: an rms as small is as good as any
SPREAD = 5  # times the best rms: frames nearer to each other than that are one
COARSE = 600  # points with which starts are refined
FINE = 8000  # points of the result


@pytree
class LogAlignParams:
    """What a frame may do, and how it is searched."""

    reflection: str = static(default="no", metadata={"choices": ("no", "yes", "either")})
    scale_limit: float = static(default=1.0, metadata={"range": (1.0, 10.0)})  # scale in 1/limit .. limit; 1: none
    backwards: bool = static(default=True)  # the log may run against the line
    keep: float = static(default=0.95, metadata={"range": (0.1, 1.0)})  # share of points that count, the nearest ones
    starts: int = static(default=12, metadata={"range": (1, 200)})  # that are refined
    iterations: int = static(default=60, metadata={"range": (1, 10_000)})  # of each start
    margin: float = static(default=1.5, metadata={"range": (1.0, 100.0)})  # times the best rms: as good as the best
    apart: float = static(default=0.02, metadata={"range": (1e-4, 1.0)})  # of the extent: frames further off differ


DEFAULT = LogAlignParams()


@host_record
class AlignStart:
    """Where one start led."""

    frame: Frame
    first_rms: float  # m, when it was held against the line
    rms: float  # m, of the points that count
    off: float  # m, rms, between its points and those of the best


@host_record
class LogAlignment:
    """The best frame, how far its points are from the line, and what else would do."""

    frame: Frame
    rms: float  # m, of the points that count
    median: float  # m, of all points
    p95: float  # m
    coverage: float  # share of the line that has points beside it
    starts: tuple[AlignStart, ...]  # by rms
    second_rms: float  # m, of the best frame that differs; infinite where there is none
    ambiguous: bool  # the second is about as good
    verdict: str


def align(
    paths: np.ndarray | Sequence[np.ndarray], line: np.ndarray, *, closed: bool, params: LogAlignParams = DEFAULT
) -> LogAlignment:
    """The frame in which paths [n, 2] (one, or several in one frame) follow a line [m, 2], both in m.

    The longest path is held against every part of the line that is as long as it, which gives the starts (closed
    form); each is refined by closest points, of which the nearest share counts. Paths and line may be parts of each
    other.
    Args: paths [n, 2] m; line [m, 2] m; closed, whether the line goes on from its last point to its first. Raises
    LogError for paths or a line that are no curves.
    """
    paths = [np.asarray(paths, float)] if isinstance(paths, np.ndarray) else [np.asarray(p, float) for p in paths]
    if not paths:
        raise LogError("align: there are no paths")
    course = LogLine.of(line, closed, "the line")
    curves = [LogLine.of(thinned(_checked(p, k), course.spacing), False, f"path {k}") for k, p in enumerate(paths)]
    limits = (1 / params.scale_limit, params.scale_limit)
    total = sum(curve.length for curve in curves)
    coarse, fine = (
        np.concatenate([curve.at(along(curve, max(int(n * curve.length / total), FEWEST))) for curve in curves])
        for n in (COARSE, FINE)
    )
    tree = cKDTree(course.points)
    lead = max(curves, key=lambda curve: curve.length)
    begun = _starts(lead, course, limits, params)
    soon = [
        (first, *refined(coarse, course, tree=tree, begin=begin, limits=limits, keep=params.keep, iterations=SOON))
        for first, begin in begun
    ]
    starts = [
        (
            first,
            *refined(
                coarse, course, tree=tree, begin=begin, limits=limits, keep=params.keep, iterations=params.iterations
            ),
        )
        for first, begin, _ in _different(sorted(soon, key=lambda item: item[2]), coarse, params.apart * course.extent)
    ]
    starts.sort(key=lambda item: item[2])
    best, rms = refined(
        fine, course, tree=tree, begin=starts[0][1], limits=limits, keep=params.keep, iterations=params.iterations
    )
    listed = tuple(AlignStart(f, first, r, apart(f, best, points=coarse)) for first, f, r in starts)
    return _judged(best, rms, fine, course, tree, listed, params)


def _checked(path: np.ndarray, k: int) -> np.ndarray:
    if path.ndim != 2 or path.shape[-1] != 2 or len(path) < 2 or not np.isfinite(path).all():
        raise LogError(f"align: path {k} {path.shape} is not [n, 2], n > 1, and finite")
    return path


def _starts(
    lead: LogLine, course: LogLine, limits: tuple[float, float], params: LogAlignParams
) -> list[tuple[float, Frame]]:
    """The best frames, each with its rms, of the path's shape held against parts of the line; no two are alike."""
    found: list[tuple[float, Frame]] = []
    guesses = {1.0, float(np.clip(course.length / lead.length, *limits))}
    for guess in sorted(guesses):
        window = min(lead.length * guess, course.length)
        slides = np.linspace(0.0, lead.length - window / guess, SLIDES if lead.length * guess > window * LONGER else 1)
        offsets = np.linspace(0.0, course.length if course.closed else course.length - window, OFFSETS)
        station = np.linspace(0.0, window, SHAPE)
        shape = lead.at(slides[:, None] + station / guess)  # [slides, SHAPE, 2]
        parts = course.at(offsets[:, None] + station)  # [offsets, SHAPE, 2]
        for part in (parts, parts[:, ::-1])[: 2 if params.backwards else 1]:
            for mirrored in mirrors(params.reflection):
                factor, translation, rms = fit(shape[:, None], part[None], reflected=mirrored, scale=limits)
                order = np.argsort(rms, axis=None)[: CANDIDATES * params.starts]
                found += [
                    (float(r), frame(complex(f), complex(t), reflected=mirrored))
                    for r, f, t in zip(*(a.flat[order] for a in (rms, factor, translation)), strict=True)
                ]
    found.sort(key=lambda item: item[0])
    points = lead.at(np.linspace(0.0, lead.length, SHAPE))
    return list(itertools.islice(_different(found, points, params.apart * course.extent), params.starts))


def _different(found: list[Any], points: np.ndarray, least: float) -> Iterator[Any]:
    """Those of some tuples, each with a frame in second place, whose frame is unlike that of all before it."""
    kept: list[Frame] = []
    for item in found:
        if all(apart(item[1], other, points=points) > least for other in kept):
            kept.append(item[1])
            yield item


def _judged(
    best: Frame,
    rms: float,
    points: np.ndarray,
    course: LogLine,
    tree: cKDTree,
    starts: tuple[AlignStart, ...],
    params: LogAlignParams,
) -> LogAlignment:
    mapped = best.apply(points)
    distance = feet(mapped, course, tree=tree)[1]
    median, p95 = (float(q) for q in np.quantile(distance, [0.5, 0.95]))
    # Per cent of the line, by the pieces that have a point beside them.
    beside = np.unique(np.asarray(tree.query(mapped)[1]) * 100 // len(course.points))
    differ = max(params.apart * course.extent, SPREAD * rms)
    second = min((s.rms for s in starts if s.off > differ), default=float("inf"))
    ambiguous = second <= max(params.margin * rms, CLOSE * course.extent)
    words = f"rms {rms:.2f} m, median {median:.2f} m, 95 % within {p95:.2f} m, {len(beside)} % of the line met"
    if ambiguous:
        words += f"; ambiguous: another frame does about as well (rms {second:.2f} m): give pairs of points"
    return LogAlignment(best, rms, median, p95, len(beside) / 100, starts, second, ambiguous, words)
