"""What gradients are worth over longer and longer horizons: their norm, and how far they are differences."""

from pathlib import Path
from typing import Any

import jax
import numpy as np

from experiments.tune.study import HorizonsParams, TuneStudy
from urbanjax.evaluation import statistics
from urbanjax.io.figures.style import BAD, figure, shades
from urbanjax.io.runs import progress, report
from urbanjax.io.runs.directory import Run
from urbanjax.numerics.soft import Relaxation
from urbanjax.tuning import space
from urbanjax.tuning.losses.closed_loop import SEGMENT, ClosedLoop
from urbanjax.tuning.starts import SceneSet, scene_set
from urbanjax.types import as_arrays, host_record

CAPTION = (
    "Gradients of the loss of single scenes, in double precision, reverse mode. Small differences: central ones of the "
    "same relaxed loss, over 2e-6 of z; wide ones: over 0.1 of z, of the loss as deployed, which is what a search by "
    "evolution follows. Of each scene; brackets: 95 % bootstrap over scenes"
)
SMALL, WIDE = 1e-6, 0.05  # of z, to either side


@host_record
class Slopes:
    """Derivatives at one horizon and temperature, scene by scene."""

    horizon: float  # s
    temperature: float
    gradient: np.ndarray  # [S, P]
    small: np.ndarray  # [S, P] central differences of the relaxed loss
    wide: np.ndarray  # [S, P] wide ones of the loss as deployed

    @property
    def norm(self) -> np.ndarray:
        """Of the gradient [S]."""
        return np.linalg.norm(self.gradient, axis=1)

    @property
    def error(self) -> np.ndarray:
        """Greatest difference from the small differences [S], relative to the greatest of these."""
        scale = np.maximum(np.abs(self.small).max(1), 1e-6)
        return np.abs(self.gradient - self.small).max(1) / scale

    @property
    def cosine(self) -> np.ndarray:
        """To the wide differences [S]; NaN where either vanishes."""
        size = self.norm * np.linalg.norm(self.wide, axis=1)
        return np.where(size > 0, np.sum(self.gradient * self.wide, axis=1) / np.where(size > 0, size, 1), np.nan)


def write(params: TuneStudy, run: Run) -> None:
    """Differentiate at every horizon and temperature; write table, figure and report."""
    with progress.bar("horizons") as tick:
        found = slopes(params, tick)
    table = _table(found)
    progress.show_table("gradients", table)
    run.table("gradients", table)
    rows = {name: [] for name in ("horizon_s", "temperature", "scene", "norm", "error", "cosine")}
    for one in found:
        for k in range(len(one.norm)):
            values = (one.horizon, one.temperature, k, one.norm[k], one.error[k], one.cosine[k])
            for name, value in zip(rows, values, strict=True):
                rows[name].append(value)
    run.table("scenes", rows)
    run.summary(_summary(found))
    draw(found, run.path("horizons.png"))
    items = [report.Picture("Over the horizon", run.path("horizons.png")), report.Table(CAPTION, table)]
    report.write_report(
        run.path("report.html"),
        "What gradients are worth",
        sections=[report.Section("Over the horizon", [], items)],
        manifest=run.manifest("complete"),
    )


def slopes(params: TuneStudy, tick: Any) -> list[Slopes]:
    """Derivatives of every horizon and temperature. Args: tick, told what is done."""
    asked: HorizonsParams = params.horizons
    base = as_arrays(params.loop())
    steps = [SEGMENT * round(float(horizon) / float(base.period) / SEGMENT) for horizon in asked.seconds]
    which = params.learned.replace(count=asked.scenes)
    tick("driving to where scenes begin", 0.0)
    where = scene_set(base, which, horizon=float(asked.seconds[-1]), seed=params.training.seed)
    found, total = [], len(steps) * len(asked.temperatures)
    with jax.enable_x64(True):
        loop = ClosedLoop(space(params.loop(), asked.weights), max(steps))
        for temperature in asked.temperatures:
            relaxation = Relaxation(float(temperature), "soft")
            for n_steps in steps:
                tick(f"{n_steps * float(base.period):g} s, temperature {float(temperature):g}", len(found) / total)
                derivatives = _at(loop, where, n_steps, relaxation)
                found.append(Slopes(n_steps * float(base.period), float(temperature), *derivatives))
    return found


def _at(
    loop: ClosedLoop, where: SceneSet, n_steps: int, relaxation: Relaxation
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gradient, small and wide differences, each [S, P]."""
    start = as_arrays(where.start)
    count, size = len(where.scenes), loop.space.size
    gradient = loop.losses(np.zeros(size), start, n_steps=n_steps, relaxation=relaxation, derivative="reverse").gradient

    def differences(step: float, relaxation: Relaxation) -> np.ndarray:
        points = step * np.concatenate([np.eye(size), -np.eye(size)])
        rows = start.at(np.tile(np.arange(count), len(points)))
        loss = loop.losses(np.repeat(points, count, axis=0), rows, n_steps=n_steps, relaxation=relaxation).loss
        ahead, behind = loss.reshape(2, size, count)
        return ((ahead - behind) / (2 * step)).T

    return gradient, differences(SMALL, relaxation), differences(WIDE, Relaxation())


def draw(found: list[Slopes], path: Path) -> None:
    """Norm, error and cosine over the horizon; thin: scenes. Args: found; path of the picture."""
    temperatures = sorted({one.temperature for one in found})
    panels = {
        "norm": ("norm of the gradient [-]", "log"),
        "error": ("relative to small differences [-]", "log"),
        "cosine": ("cosine to wide differences, deployed [-]", "linear"),
    }
    with figure(path, 10.0, height=3.6) as canvas:
        for axes, (name, (label, scale)) in zip(canvas.subplots(1, 3), panels.items(), strict=True):
            for temperature, colour in zip(temperatures, shades(len(temperatures)), strict=True):
                part = [one for one in found if one.temperature == temperature]
                x = [one.horizon for one in part]
                values = np.stack([getattr(one, name) for one in part])
                floor = 1e-12 if scale == "log" else -2
                for k in range(values.shape[1]):
                    axes.plot(x, np.maximum(values[:, k], floor), color=colour, lw=0.4, alpha=0.4)
                middle = np.nanmedian(values, axis=1)
                axes.plot(x, np.maximum(middle, floor), "o-", color=colour, ms=4, label=f"temperature {temperature:g}")
            axes.set(xlabel="horizon [s]", title=label, yscale=scale)
            if name == "cosine":
                axes.axhline(0.5, color=BAD, lw=0.8, ls=":")
                axes.set(ylim=(-1, 1))
        canvas.legend(*canvas.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=len(temperatures))


def _table(found: list[Slopes]) -> dict[str, list[Any]]:
    out: dict[str, list[Any]] = {}
    for one in found:
        line = {
            "temperature": one.temperature,
            "horizon [s]": one.horizon,
            "scenes": len(one.norm),
            "norm, median": _told(statistics.median(one.norm)),
            "norm, greatest": float(one.norm.max()),
            "off small differences, median": _told(statistics.median(one.error)),
            "off, greatest": float(one.error.max()),
            "cosine to wide ones, deployed": _cosine(one).text(2),
        }
        for name, value in line.items():
            out.setdefault(name, []).append(value)
    return out


def _summary(found: list[Slopes]) -> dict[str, float]:
    out: dict[str, float] = {}
    for one in found:
        name = f"horizon_{one.horizon:g}_s_temperature_{one.temperature:g}"
        out |= statistics.median(one.norm).flat(f"{name}_norm_median")
        out |= statistics.median(one.error).flat(f"{name}_error_median")
        out |= _cosine(one).flat(f"{name}_cosine_mean")
        out |= {f"{name}_norm_greatest": float(one.norm.max()), f"{name}_error_greatest": float(one.error.max())}
    return out


def _cosine(one: Slopes) -> statistics.WithInterval:
    return statistics.mean(one.cosine[np.isfinite(one.cosine)])


def _told(found: statistics.WithInterval) -> str:
    value, low, high = (f"{x:.2g}" for x in found)
    return f"{value} [{low}, {high}]"
