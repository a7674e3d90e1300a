"""The eight rows of Table I, each driven along the stretch from two kinds of start."""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from experiments.common.lost import lost_after
from experiments.register.bench import ANYWHERE, Bench, Seen, Setting
from urbanjax.localization import motion
from urbanjax.types import ConfigError, host_record, pytree, static

OPEN_ITERATIONS, OPEN_EPSILON = 64, 1e-3  # where the paper prints nothing
STARTS = {"previous": "last pose", "predicted": "odometry"}


@host_record
class PaperRow:
    """One row as printed; None for a dash."""

    method: str
    channels: int
    sensing: float
    window: float
    voxel: float
    threshold: float
    iterations: int | None
    epsilon: float | None
    threads: int | None
    reach: float | None
    outcome: str

    @property
    def setting(self) -> Setting:
        """What of it we have; threads we have not."""
        return Setting(
            method="ndt" if self.method == "NDT-OMP" else "vgicp",
            channels=self.channels,
            sensing=self.sensing,
            window=self.window,
            voxel=self.voxel,
            iterations=self.iterations or OPEN_ITERATIONS,
            epsilon=self.epsilon or OPEN_EPSILON,
            reach=self.reach or ANYWHERE,
        )


NDT, VGICP = "NDT-OMP", "Voxelized-GICP"
PAPER = (
    PaperRow(NDT, 128, 70.0, 70.0, 0.5, 0.2, 32, 0.01, None, None, "fail"),
    PaperRow(NDT, 64, 70.0, 70.0, 0.5, 0.2, 64, 0.01, None, None, "fail"),
    PaperRow(NDT, 64, 100.0, 100.0, 0.5, 0.2, 128, 0.01, None, None, "fail"),
    PaperRow(NDT, 64, 80.0, 80.0, 0.5, 0.2, 64, 0.03, None, None, "success"),
    PaperRow(VGICP, 96, 100.0, 100.0, 1.0, 0.5, None, None, 2, 1.0, "fail"),
    PaperRow(VGICP, 96, 100.0, 100.0, 1.0, 0.5, None, None, 10, 1.0, "fail"),
    PaperRow(VGICP, 96, 100.0, 100.0, 1.0, 0.5, None, None, 6, 1.0, "fail"),
    PaperRow(VGICP, 128, 100.0, 100.0, 1.0, 0.5, None, None, 6, 3.0, "success"),
)


@pytree
class RowsParams:
    """How long the rows are driven."""

    begin: float = 0.0  # s, of the drive, at which the pose is known: at walking pace
    give_up: float = 5.0  # m, an error from which there is no way back
    scans: int = static(default=300, metadata={"range": (2, 100_000)})


@host_record
class RowTrack:
    """T registrations one after the other, fewer where the pose was given up."""

    error: np.ndarray  # [T, 3] m, m, rad
    matching_error: np.ndarray  # [T] m
    inlier_share: np.ndarray  # [T]
    iterations: np.ndarray  # [T]
    milliseconds: np.ndarray  # [T, 3] of pre-processing, window and registration
    dropped: int  # voxels without a place, the most in one scan
    scans: int  # of the drive

    @property
    def distance(self) -> np.ndarray:
        """Planar error [T] m."""
        return np.hypot(self.error[:, 0], self.error[:, 1])


def outcome(distance: np.ndarray, milliseconds: np.ndarray, limit: float, period: float) -> tuple[bool, bool]:
    """Whether the pose was lost, and whether a scan took too long, by the median.

    Args: distance [T] m, planar errors; milliseconds [T, 3]; limit [m]; period [s].
    """
    lost = lost_after(distance, limit) is not None
    return lost, bool(np.median(milliseconds.sum(1)) > 1e3 * period)


def verdict(lost: bool, slow: bool) -> str:
    """The outcome in words."""
    reasons = [name for name, is_so in (("lost", lost), ("slow", slow)) if is_so]
    return f"fail ({', '.join(reasons)})" if reasons else "success"


def steps(bench: Bench, params: RowsParams) -> range:
    """The steps of the drive, with the first one, at which the pose is known. Raises ConfigError if there are none."""
    time = np.asarray(bench.stretch.tour.time)
    first = int(np.searchsorted(time, float(params.begin)))
    if first + 2 > len(time):
        raise ConfigError(f"'rows.begin' is {float(params.begin):g} s, but the drive takes {time[-1]:.0f} s")
    return range(first, min(first + params.scans, len(time)))


def speeds(bench: Bench, params: RowsParams) -> np.ndarray:
    """Speed [T] m/s along these steps."""
    return np.asarray(bench.stretch.tour.ego.speed)[steps(bench, params)]


def drive(
    bench: Bench, params: RowsParams, seed: int, tick: Callable[[str, float | None], None]
) -> dict[tuple[Setting, str], RowTrack]:
    """All different settings from both starts, on the same scans."""
    settings = list(dict.fromkeys(row.setting for row in PAPER))
    index = steps(bench, params)
    key = jax.random.key(seed)
    begin = bench.look(index[0], key).truth
    poses = {(setting, start): begin for setting in settings for start in STARTS}
    logs: dict[tuple[Setting, str], list[tuple]] = {who: [] for who in poses}
    for n, k in enumerate(index[1:]):
        seen = bench.look(k, key)
        kinds = dict.fromkeys((s.channels, s.sensing) for s, _ in poses)
        clouds = {kind: bench.cloud(seen, *kind) for kind in kinds}
        for who in list(poses):
            cloud = clouds[who[0].channels, who[0].sensing]
            row, poses[who] = _one(bench, *who, seen, cloud, poses[who])
            logs[who].append(row)
            if np.hypot(*row[0][:2]) > float(params.give_up):
                del poses[who]
        tick("Table I", (n + 1) / (len(index) - 1))
    return {who: _track(log, len(index) - 1) for who, log in logs.items()}


def _one(bench: Bench, setting: Setting, start: str, seen: Seen, cloud: Any, pose: Any) -> tuple[tuple, Any]:
    """One registration from the last pose."""
    if start == "predicted":
        pose = (pose @ motion.travelled(seen.odometry, bench.period)).normalize()
    window_ms, window, missed = bench.window(setting, pose.translation())
    took, found = bench.register(setting, cloud[1], window, pose, seen.truth)
    row = (
        np.asarray(found.error),
        float(found.matching_error),
        float(found.inlier_share),
        int(found.iterations),
        (cloud[0], window_ms, took),
        cloud[2] + missed,
    )
    return row, found.pose


def _track(log: list[tuple], scans: int) -> RowTrack:
    error, matching, share, iterations, times, dropped = zip(*log, strict=True)
    columns = (np.array(x, float) for x in (error, matching, share, iterations, times))
    return RowTrack(*columns, dropped=max(dropped), scans=scans)


def table(
    tracks: dict[tuple[Setting, str], RowTrack], speed: np.ndarray, limit: float, period: float
) -> dict[str, list[Any]]:
    """Table I as printed, and ours beside it: one row of the paper and one start a row. Args: speed [T + 1] m/s."""
    made = [
        {"row": k, **_row(row, start, tracks[row.setting, start], speed, limit, period)}
        for k, row in enumerate(PAPER, 1)
        for start in STARTS
    ]
    return {name: [row[name] for row in made] for name in made[0]}


def _row(row: PaperRow, start: str, track: RowTrack, speed: np.ndarray, limit: float, period: float) -> dict[str, Any]:
    lost, slow = outcome(track.distance, track.milliseconds, limit, period)
    since = lost_after(track.distance, limit)
    held = track.distance[:since]
    times = np.median(track.milliseconds, axis=0)
    shown = slice(None, since) if since is None or since > 0 else slice(None)
    return {
        "method": row.method,
        "channels": "128" if row.channels == 128 else f"{row.channels} (upper)",
        "sensing [m]": row.sensing,
        "window [m]": row.window,
        "voxel [m]": row.voxel,
        "threshold [m]": row.threshold,
        "iterations": row.iterations,
        "epsilon [m]": row.epsilon,
        "threads": row.threads,
        "distance [m]": row.reach,
        "paper": row.outcome,
        "start": STARTS[start],
        "ours": verdict(lost, slow),
        "lost after [s]": None if since is None else period * since,
        "lost at [km/h]": None if since is None else 3.6 * float(speed[since + 1]),
        "mean error [m]": float(held.mean()) if len(held) else None,
        "largest [m]": float(track.distance.max()),
        "matching error [m]": float(track.matching_error[shown].mean()),
        "above threshold [%]": 100 * float((track.matching_error[shown] > row.threshold).mean()),
        "inliers [%]": 100 * float(track.inlier_share[shown].mean()),
        "iterations used": float(track.iterations[shown].mean()),
        "pre-processing [ms]": float(times[0]),
        "window [ms]": float(times[1]),
        "registration [ms]": float(times[2]),
        "scan [ms]": float(np.median(track.milliseconds.sum(1))),
    }


def summary(rows: dict[str, list[Any]]) -> dict[str, Any]:
    """Flat numbers, by row of the paper (from 1) and start."""
    out: dict[str, Any] = {}
    names = {"mean error [m]": "mean_error_m", "largest [m]": "max_error_m", "lost after [s]": "lost_after_s"}
    names |= {"matching error [m]": "matching_error_m", "scan [ms]": "scan_ms"}
    for k, start in enumerate(rows["start"]):
        name = f"row{k // len(STARTS) + 1}_{start.replace(' ', '_')}"
        out[f"{name}_success"] = int(rows["ours"][k] == "success")
        out |= {f"{name}_{unit}": rows[column][k] for column, unit in names.items()}
    ours = [value.split()[0] for value in rows["ours"]]
    for start in STARTS.values():
        same = [a == b for a, b, s in zip(ours, rows["paper"], rows["start"], strict=True) if s == start]
        out[f"rows_as_in_the_paper_{start.replace(' ', '_')}"] = sum(same)
    return out
