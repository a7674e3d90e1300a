"""Every combination of the parameters of Table I, each on the same scans from the same starts."""

import dataclasses
import itertools
from collections.abc import Callable
from typing import Any

import jax
import jaxlie
import numpy as np

from experiments.register.bench import ANYWHERE, Bench, Found, Seen, Setting
from experiments.register.rows import OPEN_EPSILON
from urbanjax.localization import motion
from urbanjax.types import POSITIVE, ConfigError, as_arrays, host_record, pytree, static


@pytree
class FactorialParams:
    """The grid, and where registrations start."""

    speed: float = 60 / 3.6  # m/s; a start is the last pose at a speed drawn evenly between 0 and this
    yaw_rate: float = 0.2  # rad/s, standard deviation, likewise of the turn since the last pose
    position_noise: float = 0.05  # m, standard deviation of the last pose's own error
    success: float = (
        0.2  # m, planar error of a right pose: stricter than that of a lost one, since slow starts are near
    )
    channels: tuple[int, ...] = static(default=(64, 96, 128))
    sensing: tuple[float, ...] = static(default=(70.0, 100.0))  # m
    window: tuple[float, ...] = static(default=(70.0, 100.0))  # m
    voxel: tuple[float, ...] = static(default=(0.5, 1.0), metadata=POSITIVE)  # m
    iterations: tuple[int, ...] = static(default=(10, 32, 64))
    methods: tuple[str, ...] = static(default=("ndt", "vgicp"), metadata={"choices": ("ndt", "vgicp")})
    scans: int = static(default=50)

    @property
    def axes(self) -> dict[str, tuple]:
        """Levels by axis, in the order of the axes of all results."""
        return {
            "method": self.methods,
            "voxel [m]": self.voxel,
            "iterations": self.iterations,
            "channels": self.channels,
            "sensing [m]": self.sensing,
            "window [m]": self.window,
        }


@host_record
class Grid:
    """Results over the axes of `FactorialParams.axes` and, last, the scans."""

    axes: dict[str, tuple]
    speed: np.ndarray  # [N] m/s, of each start
    distance: np.ndarray  # [.., N] m, planar error
    heading: np.ndarray  # [.., N] rad, its amount
    matching_error: np.ndarray  # [.., N] m
    inlier_share: np.ndarray
    iterations: np.ndarray
    converged: np.ndarray
    milliseconds: np.ndarray  # [.., N, 3] of pre-processing, window and registration
    dropped: np.ndarray  # [N] voxels without a place, the most in one cell

    def note(self, at: tuple[int, ...], found: Found, milliseconds: tuple[float, float, float]) -> None:
        """Write down one registration."""
        self.distance[at] = np.hypot(*np.asarray(found.error[:2]))
        self.heading[at] = abs(float(found.error[2]))
        for name in ("matching_error", "inlier_share", "iterations", "converged"):
            getattr(self, name)[at] = getattr(found, name)
        self.milliseconds[at] = milliseconds

    @property
    def total(self) -> np.ndarray:
        """Milliseconds [.., N] for a scan."""
        return self.milliseconds.sum(-1)

    def over(self, values: np.ndarray, axis: str) -> np.ndarray:
        """`values` with one axis first and all others made one: [level, rest]."""
        return np.moveaxis(values, list(self.axes).index(axis), 0).reshape(len(self.axes[axis]), -1)


def checked(params: FactorialParams) -> None:
    """Raise ConfigError for a grid that cannot be run."""
    if not all(1 <= n <= 128 for n in params.channels):
        raise ConfigError("'factorial.channels' must lie between 1 and 128: the sensor has 128 rings")
    for name in ("sensing", "window", "voxel", "iterations"):
        if min(getattr(params, name)) <= 0:
            raise ConfigError(f"'factorial.{name}' must hold positive values")
    if list(params.iterations) != sorted(set(params.iterations)):
        raise ConfigError(
            "'factorial.iterations' must rise: a smaller limit that was not reached answers for larger ones"
        )


def starts(params: FactorialParams, count: int, period: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Speeds [N] m/s, and offsets [N, 3] (m, m, rad) of the last pose from the true one, in its body frame."""
    rng = np.random.default_rng(seed)
    # Evenly spread and shuffled: 50 draws alone would leave gaps.
    speed = float(params.speed) * rng.permutation((np.arange(count) + 0.5) / count)
    turn = float(params.yaw_rate) * period * rng.normal(size=count)
    noise = float(params.position_noise) * rng.normal(size=(count, 2))
    return speed, np.stack([-speed * period + noise[:, 0], noise[:, 1], -turn], 1)


def run(bench: Bench, params: FactorialParams, seed: int, tick: Callable[[str, float | None], None]) -> Grid:
    """Register every scan in every cell. A registration that converged is not repeated with a larger limit."""
    speed, offsets = starts(params, params.scans, bench.period, seed)
    steps = np.linspace(0, len(bench.stretch.tour.time) - 1, params.scans).round().astype(int)
    shape = (*map(len, params.axes.values()), params.scans)
    names = ("distance", "heading", "matching_error", "inlier_share", "iterations")
    grid = Grid(
        params.axes,
        speed,
        **{name: np.zeros(shape) for name in names},
        converged=np.zeros(shape, bool),
        milliseconds=np.zeros((*shape, 3)),
        dropped=np.zeros(params.scans, int),
    )
    key = jax.random.fold_in(jax.random.key(seed), 1)
    for n, k in enumerate(steps):
        tick("factorial", n / len(steps))
        _scan(bench, params, grid, n, bench.look(int(k), key), offsets[n])
    return grid


def _scan(bench: Bench, params: FactorialParams, grid: Grid, n: int, seen: Seen, offset: np.ndarray) -> None:
    """Register one scan in every cell."""
    off = as_arrays(jaxlie.SE2.from_xy_theta(*map(float, offset)))
    start = (seen.truth @ motion.spatial(off)).normalize()
    views = [(c, s) for c in range(len(params.channels)) for s in range(len(params.sensing))]
    clouds = {view: bench.cloud(seen, params.channels[view[0]], params.sensing[view[1]]) for view in views}
    for m, v, w in np.ndindex(len(params.methods), len(params.voxel), len(params.window)):
        method, voxel, radius = params.methods[m], params.voxel[v], params.window[w]
        setting = Setting(method, 0, 0.0, radius, voxel, 0, OPEN_EPSILON, ANYWHERE)
        window_ms, window, missed = bench.window(setting, start.translation())
        for c, s in views:
            prepare_ms, cloud, lost = clouds[c, s]
            grid.dropped[n] = max(grid.dropped[n], lost + missed)
            took, found = 0.0, None
            for i, limit in enumerate(params.iterations):
                if found is None or not found.converged:
                    one = dataclasses.replace(setting, iterations=limit)
                    took, found = bench.register(one, cloud, window, start, seen.truth)
                grid.note((m, v, i, c, s, w, n), found, (prepare_ms, window_ms, took))


def cells(grid: Grid, limit: float, period: float) -> dict[str, list[Any]]:
    """One row per cell."""
    rows: dict[str, list[Any]] = {name: [] for name in grid.axes}
    for levels in itertools.product(*grid.axes.values()):
        for name, level in zip(grid.axes, levels, strict=True):
            rows[name].append(level)
    good = grid.distance <= limit
    flat = {
        "success [%]": 100 * good.mean(-1),
        "in time [%]": 100 * (grid.total <= 1e3 * period).mean(-1),
        "median error [m]": np.median(grid.distance, -1),
        "largest error [m]": grid.distance.max(-1),
        "error of successes [m]": np.where(good, grid.distance, 0).sum(-1) / np.maximum(good.sum(-1), 1),
        "heading error, median [rad]": np.median(grid.heading, -1),
        "matching error [m]": grid.matching_error.mean(-1),
        "inliers [%]": 100 * grid.inlier_share.mean(-1),
        "iterations used": grid.iterations.mean(-1),
        "converged [%]": 100 * grid.converged.mean(-1),
        "pre-processing [ms]": np.median(grid.milliseconds[..., 0], -1),
        "window [ms]": np.median(grid.milliseconds[..., 1], -1),
        "registration [ms]": np.median(grid.milliseconds[..., 2], -1),
        "scan [ms]": np.median(grid.total, -1),
    }
    return rows | {name: values.ravel().tolist() for name, values in flat.items()}


def effects(grid: Grid, limit: float, period: float) -> dict[str, list[Any]]:
    """Main effects: one row per level of each axis, over all other axes and scans."""
    rows: dict[str, list[Any]] = {name: [] for name in EFFECTS}
    for axis, levels in grid.axes.items():
        good = grid.over(grid.distance <= limit, axis)
        error, took = grid.over(grid.distance, axis), grid.over(grid.total, axis)
        for k, level in enumerate(levels):
            held = error[k][good[k]]
            values = (axis, str(level), 100 * good[k].mean(), float(np.median(held)) if len(held) else None)
            values += (float(np.median(took[k])), 100 * float((took[k] <= 1e3 * period).mean()))
            for name, value in zip(EFFECTS, values, strict=True):
                rows[name].append(value)
    return rows


EFFECTS = ("axis", "level", "success [%]", "error of successes, median [m]", "scan, median [ms]", "in time [%]")
THRESHOLDS = (0.2, 0.5)  # m, the paper's
TRIED = np.round(np.arange(0.05, 1.2, 0.01), 2)  # m


def thresholds(grid: Grid, limit: float) -> dict[str, list[Any]]:
    """What a threshold on the matching error tells of a wrong pose: the paper's two, and the best one for each map."""
    rows: dict[str, list[Any]] = {name: [] for name in ALARMS}
    for (m, method), (v, voxel) in itertools.product(enumerate(grid.axes["method"]), enumerate(grid.axes["voxel [m]"])):
        error, wrong = grid.matching_error[m, v].ravel(), (grid.distance[m, v] > limit).ravel()
        shares = [alarms(error, wrong, value) for value in TRIED]
        gain = [(a or 0.0) - (b or 0.0) for a, b in shares]
        best = float(TRIED[int(np.argmax(gain))])
        for kind, value in (*(("paper", value) for value in THRESHOLDS), ("best", best)):
            seen, false = alarms(error, wrong, value)
            values = (method, voxel, kind, value, int(wrong.sum()), int((~wrong).sum()), seen, false)
            for name, entry in zip(ALARMS, values, strict=True):
                rows[name].append(entry)
    return rows


ALARMS = (
    "method",
    "voxel [m]",
    "threshold of",
    "threshold [m]",
    "wrong",
    "right",
    "wrong found [%]",
    "right refused [%]",
)


def alarms(error: np.ndarray, wrong: np.ndarray, threshold: float) -> tuple[float | None, float | None]:
    """Per cent of the wrong and of the right registrations whose matching error [N] m is above a threshold."""
    above = error > threshold
    found, refused = (100 * float(above[who].mean()) if who.any() else None for who in (wrong, ~wrong))
    return found, refused


def summary(grid: Grid, limit: float, period: float) -> dict[str, Any]:
    """Flat numbers: main effects, and how many registrations there were."""
    rows = effects(grid, limit, period)
    out: dict[str, Any] = {"registrations": grid.distance.size, "most_dropped_voxels": int(grid.dropped.max())}
    for axis, level, success, _, took, _ in zip(*rows.values(), strict=True):
        name = f"{axis.removesuffix(' [m]')}_{level}"
        out |= {f"{name}_success_share": success / 100, f"{name}_scan_ms": took}
    return out


def records(grid: Grid) -> dict[str, Any]:
    """One row per registration, for the table on disk."""
    index = np.indices(grid.distance.shape).reshape(grid.distance.ndim, -1)
    out: dict[str, Any] = {name: np.array(levels)[index[a]] for a, (name, levels) in enumerate(grid.axes.items())}
    out |= {"scan": index[-1], "start_speed_mps": grid.speed[index[-1]], "error_m": grid.distance.ravel()}
    out |= {"heading_error_rad": grid.heading.ravel(), "matching_error_m": grid.matching_error.ravel()}
    out |= {"inlier_share": grid.inlier_share.ravel(), "iterations_used": grid.iterations.ravel()}
    out |= {"converged": grid.converged.ravel()}
    stages = ("preprocess_ms", "window_ms", "registration_ms")
    return out | {name: grid.milliseconds[..., k].ravel() for k, name in enumerate(stages)}
