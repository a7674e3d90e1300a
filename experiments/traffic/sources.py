"""The logs of a study, judged, with the line they are measured along: from files or from rollouts of the stack."""

import glob
from collections.abc import Callable
from pathlib import Path

import numpy as np

from experiments.common import overtaking
from experiments.common.overtaking import Fig10
from experiments.traffic.study import TrafficStudy
from urbanjax.io import logs
from urbanjax.io.files import data_folder
from urbanjax.io.logs import LogError, VehicleLog, from_arrays
from urbanjax.io.logs.align import LogAlignment, align
from urbanjax.io.logs.quality import Quality, coarseness, quality
from urbanjax.io.logs.sampling import raw
from urbanjax.io.maps import racetrack
from urbanjax.sim.scenarios import overtake
from urbanjax.sim.scenarios.overtake import RIGHT
from urbanjax.types import ConfigError, host_record


@host_record
class Material:
    """What there is to compare."""

    logs: list[VehicleLog]  # that count, in the frame of the line
    judged: list[Quality]  # all logs that were read
    left_out: dict[str, str]  # name of a log -> why
    interpolated: int  # samples that were left out of those that count
    line: np.ndarray | None  # [P, 2] m
    closed: bool
    alignment: LogAlignment | None
    rollouts: Fig10 | None


def gather(study: TrafficStudy, tick: Callable[[str], None]) -> Material:
    """Read or drive, judge, align. Raises LogError or ConfigError where nothing is left to compare."""
    if study.files:
        tick("reading")
        found, line, closed, rollouts = read(study), None, study.course.closed, None
        if study.course.line:
            track = racetrack.parse(located(study.course.line, "course.line"))
            line, closed = track.position, track.closed and study.course.closed
    else:
        found, line, rollouts = driven(study, tick)
        closed = False
    _told_apart(found)
    judged = [quality(log, study.quality) for log in found]
    left_out = {q.log: q.verdict for q in judged if q.frozen}
    kept = [log for log, q in zip(found, judged, strict=True) if not q.frozen]
    samples = sum(log.n for log in kept)
    if study.teams.raw_only:  # before they are moved off the grid that tells measured samples from others
        kept = [log.take(raw(log)) for log in kept]
    if not kept:
        raise LogError("every log is frozen: there is nothing to compare")
    alignment = None
    if study.course.align:
        if line is None:
            raise ConfigError("'course.align' needs the line that logs are aligned to: set 'course.line'")
        tick("aligning")
        alignment = align([log.position for log in kept], line, closed=closed, params=study.course.frame)
        kept = [alignment.frame.log(log) for log in kept]
    return Material(kept, judged, left_out, samples - sum(log.n for log in kept), line, closed, alignment, rollouts)


def _told_apart(found: list[VehicleLog]) -> None:
    """Raise ConfigError where logs of two files have one name."""
    sources: dict[str, str] = {}
    for log in found:
        first = sources.setdefault(log.name, log.source)
        if first != log.source:
            raise ConfigError(
                f"{first} and {log.source} both hold a log named '{log.name}': let 'format.path' name teams and runs, "
                "say '{team}/{run}' for files red/1.csv and blue/1.csv"
            )


def read(study: TrafficStudy) -> list[VehicleLog]:
    """The logs of the study's files, which are looked for here and then below the data folder."""
    found = []
    for pattern in study.files:
        below = str(data_folder() / pattern)
        found += logs.read(below if not glob.glob(pattern) and glob.glob(below) else pattern, study.format)
    return found


def located(name: str, key: str) -> Path:
    """A file here or below the data folder. Raises ConfigError, naming the key, where there is none."""
    for path in (Path(name), data_folder() / name):
        if path.is_file():
            return path
    raise ConfigError(f"'{key}': there is no file {name}, neither here nor below the data folder (URBANJAX_DATA)")


def driven(study: TrafficStudy, tick: Callable[[str], None]) -> tuple[list[VehicleLog], np.ndarray, Fig10]:
    """Rollouts of the overtaking study as logs, a team for each tau and a run for each start, and the ego's lane."""
    found, _ = overtaking.drive(study.rollouts, tick)
    road = overtake.road(study.rollouts.scenario)
    drives = [
        from_arrays(
            f"tau {tau:g}",
            found.time,
            position=found.ego[a, 0, s, :, :2],
            speed=found.speed[a, 0, s],
            heading=found.ego[a, 0, s, :, 2],
            run=f"start {s}",
            source="rollout",
        )
        for a, tau in enumerate(found.taus.tolist())
        for s in range(found.speed.shape[2])
    ]
    return drives, np.asarray(road.centre[RIGHT], float), found


def quality_table(material: Material) -> dict[str, list]:
    """One row per log: what it is like and what is said against it."""
    coarse = coarseness(material.judged)
    columns: dict[str, list] = {
        "log": [q.log for q in material.judged],
        "samples": [q.samples for q in material.judged],
        "duration [s]": [q.duration for q in material.judged],
        "length [m]": [q.length for q in material.judged],
        "interpolated [%]": [100 * q.interpolated_share for q in material.judged],
        "repeated while moving": [q.repeated_moving for q in material.judged],
        "steps of [m]": [q.resolution for q in material.judged],
        "roughness [m]": [q.roughness for q in material.judged],
        "times the usual": coarse,
        "verdict": [q.verdict for q in material.judged],
    }
    return columns
