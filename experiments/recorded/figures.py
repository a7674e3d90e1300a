"""Drives among recorded traffic as pictures."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments.recorded.driving import Drive
from experiments.recorded.table import scenes_of
from urbanjax.evaluation.recorded.scenes import RecordedScene
from urbanjax.io.figures.roads import draw_boxes, draw_road
from urbanjax.io.figures.style import BAD, GOOD, OTHER, figure

MARGIN = 15.0  # m around the tracks
MARKERS = "osD^vP*X"


def draw_scene(scene: RecordedScene, drives: Sequence[Drive], path: Path) -> None:
    """The map around the recorded drives, with every drive of the stack over its recorded one."""
    tracks = np.concatenate([(d.human_path if len(d.human_path) else d.path)[:, :2] for d in drives])
    low, high = tracks.min(0) - MARGIN, tracks.max(0) + MARGIN
    size = 10.0 / max(high - low) * (high - low)
    with figure(path, max(size[0], 4.0) + 0.8, height=max(size[1], 2.2) + 0.6) as canvas:
        axes = canvas.add_subplot()
        draw_road(axes, scene.graph)
        for i, drive in enumerate(drives):
            colour = BAD if drive.at_fault else GOOD
            if len(drive.human_path):
                axes.plot(*drive.human_path[:, :2].T, color=OTHER, lw=2.6, alpha=0.6, label=None if i else "recorded")
            axes.plot(*drive.path[:, :2].T, color=colour, lw=1.1, label=None if i else "stack")
            draw_boxes(axes, np.array([[*drive.path[-1], drive.length, drive.width]]), colour=colour, filled=False)
            if drive.contact_time is not None:
                k = min(round(drive.contact_time / drive.period), len(drive.path) - 1)
                axes.plot(*drive.path[k, :2], "x", color=BAD, ms=9, mew=2, zorder=7)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), title=scene.name)
        axes.legend(loc="best")


def draw_summary(drives: Sequence[Drive], path: Path) -> None:
    """Progress of every drive beside the recorded one, and comfort of both."""
    with figure(path, 10.5, height=3.8) as canvas:
        left, middle, right = canvas.subplots(1, 3)
        top = 1.05 * max(max(d.way, d.human_way) for d in drives)
        left.plot([0, top], [0, top], color=OTHER, lw=0.8)
        for marker, (name, part) in zip(MARKERS, list(scenes_of(drives).items())[:-1], strict=False):
            at = np.array([(d.human_way, d.way) for d in part])
            colours = [BAD if d.at_fault else GOOD for d in part]
            left.scatter(*at.T, c=colours, marker=marker, s=18, label=name.replace("_T-1", ""), alpha=0.8)
        left.set(
            xlabel="recorded progress [m]", ylabel="the stack's [m]", title="a  progress (red: collision at fault)"
        )
        left.legend(loc="lower right", fontsize=7)
        _distributions(middle, drives, "b  acceleration", "[m/s²]", 1)
        _distributions(right, drives, "c  jerk", "[m/s³]", 2)


def _distributions(axes: Any, drives: Sequence[Drive], title: str, unit: str, order: int) -> None:
    """How often a change of speed of some order is exceeded in magnitude."""
    for whose, colour, label in (("human_speed", OTHER, "recorded"), ("speed", GOOD, "stack")):
        values = [np.diff(getattr(d, whose), n=order) / d.period**order for d in drives]
        size = np.sort(np.abs(np.concatenate(values)))
        axes.plot(size, 100 * (1 - np.arange(len(size)) / len(size)), color=colour, label=label)
    axes.set(yscale="log", xlabel=f"magnitude {unit}", ylabel="steps that exceed it [%]", title=title)
    axes.legend()
