"""Losses, errors by horizon, and demonstrations where default and tuned choices differ most."""

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from experiments.tune.imitation.paths import PathStudy
from experiments.tune.imitation.predictors import (
    CONSTANT,
    DEFAULT,
    LIKELY,
    LINEAR,
    NETWORK,
    PRINTED,
    WEIGHTS,
    WIDER,
    Study,
)
from experiments.tune.imitation.task import N_TIMES, RecordedDrivers
from urbanjax.evaluation import statistics
from urbanjax.evaluation.recorded.moments import SPACING
from urbanjax.io.figures.roads import draw_boxes
from urbanjax.io.figures.style import BAD, GOOD, LINE, OTHER, ROAD, figure
from urbanjax.rollout import LoopParams
from urbanjax.tuning.losses import imitation
from urbanjax.types import as_arrays

COLOURS = {
    PRINTED: "#b58900",
    DEFAULT: BAD,
    WIDER: "#e08e79",
    LIKELY: "#2aa1b3",
    WEIGHTS: "#6c71c4",
    LINEAR: GOOD,
    NETWORK: "#1f4e79",
    CONSTANT: OTHER,
}
STYLES = {CONSTANT: "--", NETWORK: ":"}
TIME = SPACING * np.arange(1, N_TIMES + 1)


def draw_errors(study: Study, drivers: RecordedDrivers, path: Path) -> None:
    """Displacement and mean displacement by horizon, with intervals over drivers."""
    with figure(path, 10.5, height=4.0) as canvas:
        left, right = canvas.subplots(1, 2)
        for name, colour in COLOURS.items():
            error = study.predictions[name].error
            mean = np.cumsum(error, axis=1) / np.arange(1, N_TIMES + 1)
            for axes, values in ((left, error), (right, mean)):
                found = [statistics.mean(values[:, k], groups=drivers.driver) for k in range(N_TIMES)]
                value, low, high = np.array(found).T
                axes.plot(TIME, value, color=colour, label=name, ls=STYLES.get(name, "-"))
                axes.fill_between(TIME, low, high, color=colour, alpha=0.12, lw=0)
        left.set(
            xlabel="after [s]", ylabel="displacement [m]", title="a  final displacement by horizon", ylim=(0, None)
        )
        right.set(xlabel="up to [s]", ylabel="[m]", title="b  average displacement up to there", ylim=(0, None))
        left.legend()


def draw_losses(study: Study, path: Path) -> None:
    """What each search saw over its steps, one line for each file that was left out."""
    searches = list(next(iter(study.losses.values())))
    with figure(path, 12.0, height=3.2) as canvas:
        for axes, search in zip(canvas.subplots(1, len(searches)), searches, strict=True):
            for name, losses in study.losses.items():
                axes.plot(losses[search], lw=1.0, label=f"without {name.split('_T')[0]}")
            unit = "-log share [nat]" if search == searches[0] else "expected FDE [m]"
            axes.set(title=search, xlabel="step", ylabel=unit)
        canvas.legend(*canvas.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=len(study.losses))


def draw_weights(columns: dict[str, list[Any]], path: Path) -> None:
    """Each tuned number over what it was, or as it is where that was 0; one dot for each file that was left out."""
    names, before = np.array(columns["number"]), np.array(columns["before"])
    there = before > 0
    with figure(path, 11.0, height=0.32 * there.sum() + 1.0) as canvas:
        left, right = canvas.subplots(1, 2, width_ratios=(2, 1))
        for k, (name, values) in enumerate(list(columns.items())[2:]):
            label, beside = name.split("_T")[0], 0.1 * (k - 2)
            left.plot(np.array(values)[there] / before[there], np.arange(there.sum()) + beside, "o", ms=4, label=label)
            right.plot(np.array(values)[~there], np.arange((~there).sum()) + beside, "o", ms=4)
        left.axvline(1.0, color=LINE, lw=0.8)
        left.set(xscale="log", xlabel="tuned over default", title="a  what was tuned")
        right.set(xlabel="tuned", title="b  what was 0", ylim=(-0.6, (~there).sum() - 0.4))
        for axes, shown in ((left, names[there]), (right, names[~there])):
            axes.set_yticks(np.arange(len(shown)), [name.replace("micro.weights.", "") for name in shown])
            axes.invert_yaxis()
        left.legend(fontsize=7)


def draw_examples(study: Study, drivers: RecordedDrivers, wide: LoopParams, path: Path, count: int = 4) -> None:
    """Moments at which tuning gained most over the default of the same fan, and the one at which it lost most."""
    gain = study.predictions[WIDER].error[:, -1] - study.predictions[LINEAR].error[:, -1]
    order, rows, seen = np.argsort(-gain), [], set()
    for i in order:
        if drivers.driver[i] not in seen and len(rows) < count - 1:
            rows.append(int(i))
            seen.add(drivers.driver[i])
    rows.append(int(order[-1]))
    with figure(path, 11.0, height=2.3 * count) as canvas:
        for axes, i in zip(canvas.subplots(count, 1, sharex=True), rows, strict=True):
            _example(axes, study, drivers, wide, i)
        reach = max(
            line.get_xdata().max() for axes in canvas.axes for line in axes.get_lines() if line.get_marker() == "."
        )
        canvas.axes[-1].set(xlim=(-15, max(float(reach), 35) + 20))
        canvas.axes[0].legend(loc="upper right", ncols=3, fontsize=7)
        canvas.axes[-1].set(xlabel="ahead [m]")


def _example(axes: Any, study: Study, drivers: RecordedDrivers, wide: LoopParams, i: int) -> None:
    one = jax.tree.map(lambda x: x[i], drivers.every)
    ego, road = one.situation.ego, one.situation.window
    angle, origin = float(ego.heading), np.asarray(ego.position)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])

    def seen(points: Any) -> np.ndarray:
        return (np.asarray(points) - origin) @ turn

    across = np.stack([-np.sin(road.heading), np.cos(road.heading)], axis=-1)[:, None]
    for side in (-0.5, 0.5):
        edge = road.position[:, None] + (road.lane_offset + side * road.lane_width)[..., None] * across
        for q in range(edge.shape[1]):
            there = road.has_lane[:, q] & road.valid
            axes.plot(*np.where(there[:, None], seen(edge[:, q]), np.nan).T, color=LINE, lw=0.5, zorder=1)
    tuned = study.tuned[str(drivers.file[i])]
    for params, who, colour in ((wide, WIDER, BAD), (tuned, LINEAR, GOOD)):
        places, whole = _places(as_arrays(params).handed_down()[0], one)
        j = int(study.predictions[who].chosen[i])
        if who == LINEAR:
            for line in np.asarray(whole):
                axes.plot(*seen(line).T, color="#d5dde6", lw=0.4, zorder=2)
        axes.plot(*seen(places[j]).T, "o-", color=colour, ms=2.5, lw=1.4, label=who, zorder=5)
    axes.plot(*seen(one.position[:N_TIMES]).T, "k.-", ms=3, lw=1.0, label="driver", zorder=6)
    others = one.situation.objects
    boxes = np.column_stack([seen(others.position), others.heading - angle, others.length, others.width])
    draw_boxes(axes, boxes[np.asarray(others.valid)], colour=OTHER)
    own = one.vehicle
    draw_boxes(axes, np.array([[own.centre_offset, 0.0, 0.0, own.length, own.width]]), colour="black", filled=False)
    axes.set(ylim=(-9, 9), ylabel="left [m]", aspect="equal", facecolor=ROAD)
    axes.set_title(
        f"{drivers.driver[i]}, {drivers.every.situation.ego.speed[i]:.1f} m/s, 3 s from this moment", fontsize=8
    )


@jax.jit
def _places(stack: Any, one: Any) -> tuple[jax.Array, jax.Array]:
    """Where each candidate is at the times of the driver, and its whole path."""
    driving = stack.driving(stack.planning).replace(vehicle=one.vehicle)
    fan = imitation.fan_of(one, driving)
    return imitation.positions_at(fan, jnp.asarray(one.time[:N_TIMES]), vehicle=one.vehicle), fan.position


def draw_paths(study: PathStudy, start: dict[str, float], path: Path) -> None:
    """Loss over the steps, and weights over temperature, which is all that a likelihood tells, over the default's."""
    with figure(path, 10.0, height=3.4) as canvas:
        left, right = canvas.subplots(1, 2)
        keys = list(start)
        for k, (name, values) in enumerate(study.losses.items()):
            label, (default, tuned) = f"without {name.split('_T')[0]}", study.temperature[name]
            ratio = [study.weights[name][key] / start[key] * default / tuned for key in keys]
            left.plot(values, lw=1.2, label=label)
            right.plot(ratio, np.arange(len(keys)) + 0.1 * (k - 2), "o", ms=4)
        left.set(xlabel="step", ylabel="-log p of a path [nat]", title="a  training loss", ylim=(0, None))
        left.legend(loc="lower right")
        right.axvline(1.0, color=LINE, lw=0.8)
        right.set(xscale="log", xlabel="tuned over default, each over its temperature", title="b  weights")
        right.set_yticks(np.arange(len(keys)), [key.rpartition(".")[2] for key in keys])
        right.invert_yaxis()
