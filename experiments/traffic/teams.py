"""Drives of teams on one course, sampled alike: the arrays that all comparisons work on."""

import jax
import numpy as np

from experiments.traffic.sources import Material
from experiments.traffic.study import CourseStudy, TeamStudy, TrafficStudy
from urbanjax.io.logs import LogError, VehicleLog
from urbanjax.io.logs.resample import by_length
from urbanjax.traffic.course.areas import Areas, areas
from urbanjax.traffic.course.laps import laps
from urbanjax.traffic.course.line import place
from urbanjax.traffic.course.sections import sections
from urbanjax.types import ConfigError, as_arrays, host_record
from urbanjax.types.errors import TrafficError

BUCKET = 256  # samples that arrays are padded to multiples of
RETURNED, LEAST_RETURNED = 0.05, 5.0  # of the extent of a drive, and m: so near to its start it has come round
SHORT = 0.05  # of a lap that may be missing where it begins or ends, if the tolerance is more
LONG = 1.3  # laps from which a log is cut
GAP = 1  # samples that do not count between two runs, so that no line joins them

_place = jax.jit(place, static_argnames=("closed", "block"))
_laps = jax.jit(laps, static_argnames="closed")


@host_record
class Teams:
    """T teams with up to n samples each, in the order driven, run after run."""

    names: list[str]  # T
    points: np.ndarray  # [T, n, 2] m from the origin
    origin: np.ndarray  # [2] m
    valid: np.ndarray  # [T, n] bool
    run: np.ndarray  # [T, n] int, which of the team's runs
    station: np.ndarray  # [T, n] m along the line
    offset: np.ndarray  # [T, n] m beside it, left positive
    speed: np.ndarray  # [T, n] m/s, from positions and times
    lap_times: list[np.ndarray]  # T times [runs] s
    line: np.ndarray  # [P, 2] m from the origin
    length: float  # m
    closed: bool
    areas: Areas
    paired: bool  # run k of all teams began alike
    dropped: dict[str, int]  # how much was left out, and what

    @property
    def runs(self) -> np.ndarray:
        """How many runs each team has [T]."""
        return np.where(self.valid, self.run, -1).max(1) + 1


def stack(study: TrafficStudy, material: Material) -> Teams:
    """The logs by team, cut into laps where they hold several, at even spacing.

    Raises LogError for a lone team, ConfigError for one with too few samples.
    """
    line = material.line if material.line is not None else middle(material.logs, study.teams, material.closed)
    origin = np.round(line.mean(0))
    line = (line - origin).astype(np.float32)
    counts = np.ones(len(line), bool)
    team_names = list(dict.fromkeys(log.team for log in material.logs))
    if len(team_names) < 2:
        raise LogError(f"a comparison needs two teams or more; the logs have {', '.join(team_names)}")
    dropped = {"interpolated": material.interpolated, "standing": 0, "seconds in gaps": 0}
    drives: dict[str, list[np.ndarray]] = {name: [] for name in team_names}
    times: dict[str, list[float]] = {name: [] for name in team_names}
    length = 0.0
    for log in material.logs:
        if study.teams.spacing:
            even = by_length(log, study.teams.spacing, longest_gap=study.teams.longest_gap)
            dropped["standing"] += even.standing
            dropped["seconds in gaps"] += round(even.gap_time)
            log = even.log
        samples, seconds, length = _placed(log, line, counts, origin, material.closed, study.course)
        drives[log.team] += samples
        times[log.team] += seconds
    if material.rollouts is not None:
        dropped["beyond the stations of all"] = _clipped(drives)
    table, run, valid = _padded(list(drives.values()))
    _enough(team_names, valid.sum(1), max(study.teams.divergence.ks))
    return Teams(
        names=team_names,
        points=table[..., :2].astype(np.float32),
        origin=origin,
        valid=valid,
        run=run,
        station=table[..., 2].astype(np.float32),
        offset=table[..., 3].astype(np.float32),
        speed=table[..., 4].astype(np.float32),
        lap_times=[np.array(times[name]) for name in team_names],
        line=line,
        length=length,
        closed=material.closed,
        areas=named_areas(study.course, line, length, material.closed),
        paired=study.teams.paired or material.rollouts is not None,
        dropped=dropped,
    )


def _clipped(drives: dict[str, list[np.ndarray]]) -> int:
    """Leave the stations that all drives of one duration reach, so that progress is no distance; how many went."""
    parts = [part for each in drives.values() for part in each]
    low, high = max(part[:, 2].min() for part in parts), min(part[:, 2].max() for part in parts)
    for name, each in drives.items():
        drives[name] = [part[(part[:, 2] >= low) & (part[:, 2] <= high)] for part in each]
    return sum(map(len, parts)) - sum(len(part) for each in drives.values() for part in each)


def _padded(drives: list[list[np.ndarray]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Samples [T, n, 5], the run of each [T, n] and which are there [T, n], run after run."""
    n = max(sum(len(part) + GAP for part in parts) for parts in drives)
    n = -(-n // BUCKET) * BUCKET
    table, run = np.zeros((len(drives), n, 5)), np.zeros((len(drives), n), int)
    valid = np.zeros((len(drives), n), bool)
    for t, parts in enumerate(drives):
        at = 0
        for k, part in enumerate(parts):
            table[t, at : at + len(part)], run[t, at : at + len(part)] = part, k
            valid[t, at : at + len(part)] = True
            at += len(part) + GAP
    return table, run, valid


def _enough(names: list[str], count: np.ndarray, k: int) -> None:
    """Raise ConfigError for a team without as many neighbours of a sample as are asked for."""
    t = int(np.argmin(count))
    if count[t] <= k:
        raise ConfigError(
            f"'teams.divergence.ks': {names[t]} has {count[t]} samples, too few for k = {k}; "
            "take a smaller k, or a smaller 'teams.spacing'"
        )


def _placed(
    log: VehicleLog, line: np.ndarray, counts: np.ndarray, origin: np.ndarray, closed: bool, course: CourseStudy
) -> tuple[list[np.ndarray], list[float], float]:
    """Samples [n, 5] (x, y, station, offset, speed) of each run of a log, the runs' times, the length of the line."""
    n = -(-log.n // BUCKET) * BUCKET
    points = np.zeros((n, 2), np.float32)
    points[: log.n] = log.position - origin
    mask = np.arange(n) < log.n
    at = _place(points, mask, line=line, line_mask=counts, closed=closed)
    time = np.pad(log.time - log.time[0], (0, n - log.n), mode="edge").astype(np.float32)
    params = course.laps.replace(tolerance=min(float(course.laps.tolerance), SHORT * float(at.length)))
    found = _laps(at.station, time, mask=mask, length=at.length, params=as_arrays(params), closed=closed)
    step = np.hypot(*np.diff(log.position, axis=0).T)
    speed = np.interp(log.time, 0.5 * (log.time[1:] + log.time[:-1]), step / np.diff(log.time))
    columns = np.stack([*points.T, np.asarray(at.station), np.asarray(at.offset)], axis=1)[: log.n]
    rows = np.concatenate([columns, speed[:, None]], axis=1)
    complete = np.asarray(found.complete)
    if not complete.any() or step.sum() < LONG * float(at.length):  # one run, as it was logged
        return [rows], [float(log.time[-1] - log.time[0])], float(at.length)
    lap = np.asarray(found.lap)[: log.n]
    which = np.flatnonzero(complete)
    return [rows[lap == k] for k in which], np.asarray(found.time)[which].tolist(), float(at.length)


def middle(logs: list[VehicleLog], study: TeamStudy, closed: bool) -> np.ndarray:
    """The first drive [P, 2], m, at even spacing, in the place of a reference line; if closed, its first lap."""
    path = by_length(logs[0], max(study.spacing, 1.0), longest_gap=study.longest_gap).log.position
    away = np.hypot(*(path - path[0]).T)
    step = np.diff(path, axis=0, append=path[-1:])
    here = (away < max(RETURNED * away.max(), LEAST_RETURNED)) & (step @ step[0] >= 0)
    left = int(np.argmin(here))
    back = left + int(np.argmax(here[left:]))
    if not closed or not here[back]:
        return path
    gone = back + int(np.argmin(np.append(here[back:], False)))
    return path[: back + int(np.argmin(away[back:gone]))]


def named_areas(course: CourseStudy, line: np.ndarray, length: float, closed: bool) -> Areas:
    """The areas of the config, or straights and curves. Raises ConfigError for one that is no name:from:to."""
    named = []
    for text in course.areas:
        parts = text.rsplit(":", 2)
        try:
            named.append((parts[0], float(parts[1]), float(parts[2])))
        except (IndexError, ValueError) as error:
            raise ConfigError(f"'course.areas': {text!r} is not name:from:to, with stations in m") from error
    if named:
        return areas(named, length)
    try:
        return sections(line, course.sections, closed=closed)
    except TrafficError:  # too short for two sections
        return areas([("course", 0.0, length)], length)
