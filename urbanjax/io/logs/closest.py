"""A frame drawn onto a line by closest points, of which the nearest share counts."""

import numpy as np
from scipy.spatial import cKDTree

from urbanjax.io.logs.frame import Frame, apart, fit, frame
from urbanjax.io.logs.line import LogLine

SETTLED = 1e-6  # of the line's extent: a step that moves points by less is the last
SINGULAR = 1e-9  # of the largest singular value: what the points do not fix stays as it is
SLIDES = 15  # most steps that let points slide along the line


def refined(
    points: np.ndarray,
    course: LogLine,
    *,
    tree: cKDTree,
    begin: Frame,
    limits: tuple[float, float],
    keep: float,
    iterations: int,
) -> tuple[Frame, float]:
    """The frame that closest points [n, 2] lead to from a first one, and the rms of the share that counts, m.

    The closed form draws points to their feet, which is sure but slow along the line; then steps of least squares
    across the line (Gauss-Newton) end it, as far as they lessen the rms.
    Args: points [n, 2] m; course, the line; tree of its points; begin, the first frame; limits of the scale; keep, the
    share of points that counts; iterations of the closed form at most.
    """
    count = max(int(np.ceil(keep * len(points))), 2)
    here = begin
    for _ in range(iterations):
        foot, distance = feet(here.apply(points), course, tree=tree)
        nearest = np.argpartition(distance, count - 1)[:count]
        factor, translation, _ = fit(points[nearest], foot[nearest], reflected=begin.reflected, scale=limits)
        before, here = here, frame(complex(factor), complex(translation), reflected=begin.reflected)
        if apart(before, here, points=points) < SETTLED * course.extent:
            break
    rms = _rms(points, course, tree, here, count)
    for _ in range(SLIDES):
        after = _across(points, course, tree, here, limits, count)
        less = _rms(points, course, tree, after, count)
        if less >= rms:
            break
        settled = apart(after, here, points=points) < SETTLED * course.extent
        here, rms = after, less
        if settled:
            break
    return here, rms


def feet(points: np.ndarray, course: LogLine, *, tree: cKDTree) -> tuple[np.ndarray, np.ndarray]:
    """Nearest points of the line [n, 2] and distances to them [n], m.

    Args: points [n, 2] m; course, the line; tree of its points.
    """
    near = np.asarray(tree.query(points)[1])
    base, tangent = course.points[near], course.tangent[near]
    ahead = np.clip(np.sum((points - base) * tangent, -1), course.behind[near], course.ahead[near])
    foot = base + ahead[:, None] * tangent
    return foot, np.linalg.norm(points - foot, axis=-1)


def _rms(points: np.ndarray, course: LogLine, tree: cKDTree, here: Frame, count: int) -> float:
    distance = feet(here.apply(points), course, tree=tree)[1]
    return float(np.sqrt(np.mean(np.partition(distance, count - 1)[:count] ** 2)))


def _across(
    points: np.ndarray, course: LogLine, tree: cKDTree, here: Frame, limits: tuple[float, float], count: int
) -> Frame:
    """The frame after one step of least squares on the distances across the line."""
    mapped = here.apply(points)
    foot, distance = feet(mapped, course, tree=tree)
    nearest = np.argpartition(distance, count - 1)[:count]
    tangent = course.tangent[np.asarray(tree.query(mapped[nearest])[1])]
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], -1)
    middle = mapped[nearest].mean(0)
    arm = mapped[nearest] - middle
    columns = [normal[:, 0], normal[:, 1], np.sum(normal * np.stack([-arm[:, 1], arm[:, 0]], -1), -1)]
    if limits[0] < limits[1]:
        columns.append(np.sum(normal * arm, -1))
    off = np.sum(normal * (foot - mapped)[nearest], -1)
    x, y, rotation, *growth = np.linalg.lstsq(np.stack(columns, -1), off, rcond=SINGULAR)[0]
    scale = float(np.clip(here.scale * (1 + (growth[0] if growth else 0.0)), *limits))
    after = Frame(scale, here.reflected, here.rotation + float(rotation), (0.0, 0.0))
    # Turned and scaled about the middle of the points, which then moves by (x, y).
    translation = middle + np.array([x, y]) - after.apply(here.inverse().apply(middle))
    return Frame(scale, here.reflected, after.rotation, (float(translation[0]), float(translation[1])))
