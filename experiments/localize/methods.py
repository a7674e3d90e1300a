"""Table II: the ways of localizing compared on one drive, and what each comes to."""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from experiments.common.district import World
from experiments.common.lost import lost_after
from experiments.localize.faults import WRONG
from experiments.localize.study import LocalizeStudy
from experiments.localize.track import LocalizedTrack, LocalizerPrograms
from urbanjax.evaluation import statistics, survey
from urbanjax.evaluation.statistics import WithInterval
from urbanjax.localization.motion import arc
from urbanjax.types import as_arrays, host_record

LOST = 2.0  # m, an error from which a method without a way back counts as diverged


@host_record
class Method:
    """A row of the table: errors [T, 3] (longitudinal m, lateral m, heading rad) at the scans it gives a pose for."""

    name: str
    error: np.ndarray
    scans: int  # of the drive
    milliseconds: np.ndarray  # per scan
    failures: int
    path: np.ndarray  # [T, 3] x, y, heading
    outputs: int = 0  # poses, with those put out between scans

    @property
    def distance(self) -> np.ndarray:
        """Planar errors [T] m."""
        return np.hypot(self.error[:, 0], self.error[:, 1])

    @property
    def coverage(self) -> WithInterval:
        """Share of the scans of the drive with an error below WRONG."""
        return statistics.rate(np.arange(self.scans) < (self.distance < WRONG).sum())

    @property
    def diverged(self) -> int | None:
        """Scan from which on the error stays above LOST."""
        return lost_after(self.distance, LOST)


VARIANTS = {
    "proposed": {},
    "proposed, Eq. 8-10": {"start": "predict_on_failure"},
    "scan match w/o": {"start": "previous", "fallback": False},
}


def compare(
    study: LocalizeStudy, world: World, tick: Callable[[str, float | None], None]
) -> tuple[list[Method], dict[str, LocalizedTrack]]:
    """All methods on the whole drive (or `scans` of it), and the tracks that they come from."""
    localizer = survey.mounted(study.localizer, study.world.sensor, period=study.world.drive.period)
    last = len(world.tour.time) if not study.scans else min(study.scans, len(world.tour.time))
    tracks = {}
    for name, changes in VARIANTS.items():
        programs = LocalizerPrograms(
            world, *as_arrays((localizer.replace(**changes), study.search, study.world.sensor))
        )
        done = iter(range(1, last + 1))
        tracks[name] = programs.run(
            jax.random.key(study.seed),
            range(last),
            stop_at=float(study.give_up) if changes.get("fallback") is False else None,
            tick=lambda name=name, done=done: tick(name, next(done) / last),
        )
    return _methods(world, tracks, last, float(study.output_rate), float(study.world.drive.period)), tracks


def _methods(world: World, tracks: dict[str, LocalizedTrack], scans: int, rate: float, period: float) -> list[Method]:
    made = []
    per_scan = max(round(rate * period), 1)
    for name, track in tracks.items():
        rows = track.rows
        failures = int(rows.failed.sum())
        made.append(
            Method(name, rows.error, scans, track.milliseconds[1:], failures, rows.pose, per_scan * len(rows.failed))
        )
    main = tracks["proposed"]
    away, path = _from_start(world, main)
    made.insert(2, Method("LiDAR odometry", away, scans, main.milliseconds[1:], 0, path, len(away)))
    literal = tracks["proposed, Eq. 8-10"]
    kept = ~literal.rows.failed
    matched = Method(
        "scan match w.",
        literal.rows.registered[kept],
        scans,
        literal.milliseconds[1:],
        int((~kept).sum()),
        literal.rows.pose[kept],
        int(kept.sum()),
    )
    made.insert(3, matched)
    return made


def _from_start(world: World, track: LocalizedTrack) -> tuple[np.ndarray, np.ndarray]:
    """Errors and path of odometry alone, begun at the true pose."""
    ego = world.tour.ego
    truth = np.concatenate([np.asarray(ego.position, float), np.asarray(ego.heading, float)[:, None]], 1)
    path = compose(truth[0], np.asarray(track.rows.odometry, float))
    return between(truth[track.index], path), path


def compose(start: np.ndarray, moves: np.ndarray) -> np.ndarray:
    """Poses [T, 3] (x, y, heading) of `moves` [T, 3] seen from `start` [.., 3]."""
    cos, sin = np.cos(start[..., 2]), np.sin(start[..., 2])
    x = start[..., 0] + cos * moves[..., 0] - sin * moves[..., 1]
    y = start[..., 1] + sin * moves[..., 0] + cos * moves[..., 1]
    return np.stack([x, y, start[..., 2] + moves[..., 2]], -1)


def between(truth: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Errors [T, 3] (longitudinal, lateral, heading) of poses [T, 3] in the true body frames."""
    away = pose - truth
    cos, sin = np.cos(truth[..., 2]), np.sin(truth[..., 2])
    turn = (away[..., 2] + np.pi) % (2 * np.pi) - np.pi
    return np.stack([cos * away[..., 0] + sin * away[..., 1], cos * away[..., 1] - sin * away[..., 0], turn], -1)


def between_scans(world: World, track: LocalizedTrack, rate: float, period: float) -> np.ndarray:
    """Planar errors [T, n] m of the poses put out from each scan to the next, by wheel speed and yaw rate."""
    tour = world.tour
    n = max(round(rate * period), 1)
    later = np.arange(n) / rate
    k = track.index
    odometry, ego = tour.odometry, tour.ego

    def moved(speed: Any, yaw_rate: Any) -> np.ndarray:
        speed, yaw_rate = (np.repeat(np.asarray(x)[k], n) for x in (speed, yaw_rate))
        time = np.tile(later, len(k)).astype(speed.dtype)
        return np.asarray(arc(jax.numpy.asarray(speed), jax.numpy.asarray(yaw_rate), time=jax.numpy.asarray(time))).T

    truth = np.concatenate([np.asarray(ego.position, float)[k], np.asarray(ego.heading, float)[k][:, None]], 1)
    there = compose(np.repeat(truth, n, 0), moved(ego.speed, tour.yaw_rate))
    found = compose(np.repeat(np.asarray(track.rows.pose, float), n, 0), moved(odometry.speed, odometry.yaw_rate))
    off = between(there, found)
    return np.hypot(off[:, 0], off[:, 1]).reshape(len(k), n)


def table(methods: list[Method], period: float) -> dict[str, list[Any]]:
    """Columns by heading, one row per method."""
    rows: dict[str, list[Any]] = {"method": [m.name for m in methods]}
    rows["mean error [m]"] = [_mean(m.distance).text(4) for m in methods]
    rows["largest [m]"] = [float(m.distance.max()) if len(m.distance) else None for m in methods]
    rows["longitudinal [m]"] = [float(np.abs(m.error[:, 0]).mean()) if len(m.error) else None for m in methods]
    rows["lateral [m]"] = [float(np.abs(m.error[:, 1]).mean()) if len(m.error) else None for m in methods]
    rows["coverage [%]"] = [m.coverage.percent.text() for m in methods]
    rows["poses"] = [m.outputs for m in methods]
    rows["scans per s"] = [1e3 / float(np.median(m.milliseconds)) if len(m.milliseconds) else None for m in methods]
    rows["failed scans"] = [m.failures for m in methods]
    rows["lost after [s]"] = [None if m.diverged is None else period * m.diverged for m in methods]
    return rows


def _mean(distance: np.ndarray) -> WithInterval:
    """With an interval from whole stretches of the drive: the errors of neighbouring scans depend on each other."""
    return statistics.mean(distance, groups=statistics.stretches(len(distance)))


def as_printed(rows: dict[str, list[Any]]) -> dict[str, list[Any]]:
    """The table on its side, as in the paper: one row per quantity, one column per method."""
    names = [name for name in rows if name != "method"]
    return {"": names, **{method: [rows[name][i] for name in names] for i, method in enumerate(rows["method"])}}


def summary(methods: list[Method], period: float) -> dict[str, Any]:
    """Flat numbers: name of the method and unit."""
    out: dict[str, Any] = {}
    for m in methods:
        name = m.name.replace(", Eq. 8-10", " literal").replace(".", "").replace("/", "").replace(" ", "_").lower()
        out |= {
            **_mean(m.distance).flat(f"{name}_mean_error_m"),
            f"{name}_max_error_m": m.distance.max(),
            f"{name}_longitudinal_m": np.abs(m.error[:, 0]).mean(),
            f"{name}_lateral_m": np.abs(m.error[:, 1]).mean(),
            **m.coverage.flat(f"{name}_coverage_share"),
            f"{name}_poses": m.outputs,
            f"{name}_step_median_ms": np.median(m.milliseconds),
            f"{name}_step_p99_ms": np.percentile(m.milliseconds, 99),
            f"{name}_failed_scans": m.failures,
            f"{name}_lost_after_s": None if m.diverged is None else period * m.diverged,
        }
    return out
