"""A map as a picture: lanes, borders, directions, signals, recorded tracks."""

from pathlib import Path
from typing import Any

import numpy as np

from urbanjax.io.figures.roads import draw_road
from urbanjax.io.figures.style import BAD, GOOD, figure
from urbanjax.io.maps.road import RoadMap
from urbanjax.roadmap.graph import Rule

ARROW = "#4a6fa5"
TRACK = "#d98c21"
SIZE = 11.0  # inches, of the longer side
MOST_ARROWS = 600


def draw_map(found: RoadMap, path: Path) -> None:
    """The map from above, in metres around the graph's origin.

    Grey lanes are roads, blue ones links inside junctions, ochre ones highways; red bars are stop lines of signals,
    triangles ends where one yields, squares those where one stops; orange lines recorded tracks, with the boxes of
    their first states.
    Args: found, the map; path of the picture.
    """
    graph = found.graph
    ends = np.concatenate([np.asarray(graph.left), np.asarray(graph.right)]).reshape(-1, 2)
    low, high = ends.min(0), ends.max(0)
    span = np.maximum(high - low, 0.05 * (high - low).max())
    width, height = np.clip(SIZE * span / span.max(), 3.5, SIZE)
    with figure(path, float(width) + 0.8, height=float(height) + 0.6) as canvas:
        axes = canvas.add_subplot()
        inches = 3.5 * SIZE / float(span.max())  # a lane's width
        draw_road(axes, graph, line=min(1.0, 20 * inches))
        _directions(axes, graph)
        _rules(axes, graph, float(np.clip(60 * inches, 1.2, 3.5)))
        _traffic(axes, found)
        margin = 0.03 * span.max()
        axes.set(xlim=(low[0] - margin, high[0] + margin), ylim=(low[1] - margin, high[1] + margin))
        axes.set(xlabel=f"east of {found.graph.origin[0]:.0f} [m]", ylabel=f"north of {found.graph.origin[1]:.0f} [m]")
        length = float(np.sum(np.asarray(graph.length, float))) / 1000
        axes.set_title(f"{found.path.stem} ({found.format}): {len(found.ids)} links, {length:.2f} km")
        if axes.get_legend_handles_labels()[0]:
            axes.legend(loc="best")


def _directions(axes: Any, graph: Any) -> None:
    """An arrow in the middle of each lane, of the longest ones where there are many."""
    centre, heading = np.asarray(graph.centre), np.asarray(graph.heading)
    chosen = np.argsort(-np.asarray(graph.length))[:MOST_ARROWS]
    k = centre.shape[1] // 2
    place, angle = centre[chosen, k], heading[chosen, k]
    size = 1.0 if len(chosen) < 150 else 0.5
    scale = {"angles": "xy", "pivot": "mid", "color": ARROW, "scale": 60 / size, "width": 0.0012 + 0.001 * size}
    axes.quiver(*place.T, np.cos(angle), np.sin(angle), headwidth=5, headlength=6, zorder=3, **scale)


def _rules(axes: Any, graph: Any, size: float) -> None:
    """Stop lines of signals, and ends where one yields or stops."""
    from matplotlib.collections import LineCollection

    left, right = np.asarray(graph.left), np.asarray(graph.right)
    last = left.shape[1] - 1
    link, slot = np.nonzero(np.asarray(graph.has_signal))
    at = np.asarray(graph.stop_line)[link, slot] / np.asarray(graph.length)[link] * last
    k = np.clip(np.round(at).astype(int), 0, last)
    if len(link):
        bars = np.stack([left[link, k], right[link, k]], 1)
        axes.add_collection(LineCollection(list(bars), colors=BAD, linewidths=1.8, zorder=4, label="signal"))
    rule, end = np.asarray(graph.rule), np.asarray(graph.centre)[:, -1]
    for kind, marker, colour, label in ((Rule.YIELD, "v", "#b8860b", "yield"), (Rule.STOP, "s", BAD, "stop")):
        if np.any(rule == kind):
            axes.plot(*end[rule == kind].T, marker, color=colour, ms=size, ls="none", zorder=4, label=label)


def _traffic(axes: Any, found: RoadMap) -> None:
    """Recorded tracks with the boxes of their first states, and where planning problems start."""
    from matplotlib.collections import LineCollection, PolyCollection

    recording = found.recording
    if recording is not None:
        tracks = [recording.position[valid, v] for v, valid in enumerate(recording.valid.T)]
        axes.add_collection(LineCollection(tracks, colors=TRACK, linewidths=1.0, zorder=5, label="recorded"))
        first = recording.valid.argmax(0)
        rows = np.arange(len(first))
        angle, place = recording.heading[first, rows], recording.position[first, rows]
        along = np.stack([np.cos(angle), np.sin(angle)], -1) * 0.5 * recording.length[:, None]
        aside = np.stack([-np.sin(angle), np.cos(angle)], -1) * 0.5 * recording.width[:, None]
        corners = [place + s * along + t * aside for s, t in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
        boxes = np.stack(corners, 1)
        axes.add_collection(PolyCollection(list(boxes), facecolors=TRACK, edgecolors="none", alpha=0.8, zorder=5))
    for n, problem in enumerate(found.problems):
        label = {"label": "start"} if n == 0 else {}
        axes.plot(*problem.position, "*", color=GOOD, ms=9, ls="none", zorder=6, **label)
