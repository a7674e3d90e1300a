"""Sweeps as they lie on disk: the plan, and what became of each job, from manifests alone."""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from urbanjax.io import files
from urbanjax.io.runs.directory import COMPLETE, FAILED, MANIFEST
from urbanjax.io.runs.sweeps.plan import FILE, PlannedJob, overridden
from urbanjax.types import ConfigError, FileError, host_record

MISSING = "missing"


@host_record
class SweepPlan:
    """What a sweep was to do."""

    folder: Path
    name: str
    experiment: str
    code: str  # hash of the sources
    command: str
    fixed: tuple[str, ...]  # overrides of all jobs, as typed
    versions: Mapping[str, Any]
    config: Mapping[str, Any]  # nested, of all jobs but for their overrides
    axes: Mapping[str, Mapping[str, Any]]  # by dotted key: kind, values, log
    jobs: tuple[PlannedJob, ...]


@host_record
class SweepJob:
    """One planned job and what became of it."""

    sweep: str
    name: str
    folder: Path
    experiment: str
    code: str
    overrides: Mapping[str, Any]  # plain values by dotted key
    config: Mapping[str, Any]  # nested, with the overrides
    status: str  # complete, failed or missing
    error: str | None
    summary: Mapping[str, Any]
    identity: str  # the same for jobs that compute the same
    started: str | None = None  # as its manifest has it
    wall_time_s: float | None = None

    @property
    def title(self) -> str:
        """Sweep and job, as a reader looks for it on disk."""
        return f"{self.sweep}/{self.name}"

    def value(self, key: str) -> Any:
        """What it has for a dotted key, overridden or not; None where it has no such key. Args: key."""
        return self.overrides[key] if key in self.overrides else at(self.config, key)


@host_record
class SweepCoverage:
    """How many jobs there are of those that were planned."""

    expected: int
    complete: int
    failed: int
    missing: int
    duplicates: int  # planned by two sweeps: counted once

    @property
    def whole(self) -> bool:
        """Whether every job is complete."""
        return self.complete == self.expected

    @property
    def text(self) -> str:
        """In one line."""
        return (
            f"{self.expected} jobs planned: {self.complete} complete, {self.failed} failed, {self.missing} missing; "
            f"{self.duplicates} more are the same as one of them and counted once"
        )


def sweeps_in(directories: Sequence[str]) -> list[SweepPlan]:
    """The sweeps in some directories, each once. Args: directories of sweeps, or folders of them.

    Raises ConfigError for a directory that is neither. Raises FileError for a plan that cannot be read.
    """
    if not directories:
        raise ConfigError(
            "name the directories of sweeps, as in: python -m experiments.collect outputs/evaluate/sweeps"
        )
    folders = dict.fromkeys(folder.resolve() for name in directories for folder in _folders(files.path_of(name)))
    return [plan_of(folder) for folder in folders]


def _folders(directory: Path) -> Iterator[Path]:
    if not directory.is_dir():
        raise ConfigError(f"dirs: there is no directory {directory}")
    found = [directory] if (directory / FILE).is_file() else sorted(path.parent for path in directory.glob(f"*/{FILE}"))
    if not found:
        raise ConfigError(
            f"dirs: {directory} is no sweep and no folder of sweeps: there is no {FILE} in it or below it"
        )
    return iter(found)


def plan_of(folder: Path) -> SweepPlan:
    """The plan of a sweep. Args: folder of it. Raises FileError, naming the file, for what is none."""
    path = folder / FILE
    plan = _read(path)
    jobs = [_planned(path, job) for job in _of(path, plan, "jobs", list)]
    if not jobs:
        raise FileError(f"{path}: plans no jobs: leave this directory out, or run its sweep again")
    names = [job.name for job in jobs]
    if len(set(names)) < len(names):
        raise FileError(f"{path}: two jobs have one name")
    texts = {"name": str(plan.get("sweep") or folder.name), "code": str(plan.get("code") or "")}
    return SweepPlan(
        folder=folder,
        experiment=_of(path, plan, "experiment", str),
        command=str(plan.get("command") or ""),
        fixed=tuple(map(str, plan.get("fixed") or ())),
        versions=_of(path, plan, "versions", dict, {}),
        config=_of(path, plan, "config", dict, {}),
        axes={key: axis for key, axis in _of(path, plan, "axes", dict, {}).items() if isinstance(axis, dict)},
        jobs=tuple(jobs),
        **texts,
    )


def _planned(path: Path, job: Any) -> PlannedJob:
    name, overrides = (job.get("name"), job.get("overrides")) if isinstance(job, dict) else (None, None)
    if (
        not isinstance(name, str)
        or name in ("", ".", "..")
        or set(name) & set("/\\\0")
        or not isinstance(overrides, dict)
    ):
        raise FileError(f"{path}: a job must have a name, which is that of its directory, and overrides, not {job!r}")
    return PlannedJob(name, overrides, str(job.get("content") or ""))


def jobs_of(plan: SweepPlan) -> list[SweepJob]:
    """All planned jobs with what became of them; none is left out. Args: plan, whose folder holds their manifests."""
    return [_job(plan, job) for job in plan.jobs]


def _job(plan: SweepPlan, job: PlannedJob) -> SweepJob:
    folder = plan.folder / job.name
    status, error, manifest = _ended(folder / MANIFEST, job.overrides)
    summary, config = manifest.get("summary"), manifest.get("config")
    planned = overridden(plan.config, job.overrides)
    return SweepJob(
        sweep=plan.name,
        name=job.name,
        folder=folder,
        experiment=plan.experiment,
        code=plan.code,
        overrides=job.overrides,
        config=config if isinstance(config, dict) else planned,
        status=status,
        error=error,
        summary=summary if isinstance(summary, dict) else {},
        identity=job.content or json.dumps([plan.experiment, plan.code, _alike(planned)], sort_keys=True),
        started=manifest.get("started"),
        wall_time_s=manifest.get("wall_time_s"),
    )


def _alike(value: Any) -> Any:
    """A value of which 1 and 1.0 are the same."""
    if isinstance(value, Mapping):
        return {name: _alike(held) for name, held in value.items()}
    if isinstance(value, list):
        return [_alike(held) for held in value]
    return float(value) if isinstance(value, int) and not isinstance(value, bool) else value


def _ended(path: Path, overrides: Mapping[str, Any]) -> tuple[str, str | None, dict[str, Any]]:
    """Status, cause and manifest of one job."""
    if not path.exists():
        begun = "it has begun, but did not end" if path.parent.is_dir() else "it has not begun"
        return MISSING, begun, {}
    try:
        manifest = _read(path)
    except FileError as error:
        return FAILED, f"{error}: delete its directory to have it run again", {}
    status, error = manifest.get("status"), manifest.get("error")
    if manifest.get("overrides", overrides) != overrides:
        return FAILED, f"{path}: is of other overrides than planned: delete its directory to have it run again", {}
    if status not in (COMPLETE, FAILED):
        return FAILED, f"{path}: has the status {status!r}", manifest
    return status, str(error or "it says no cause") if status == FAILED else None, manifest


def unique(jobs: Sequence[SweepJob]) -> tuple[list[SweepJob], dict[str, str]]:
    """Each job once, and what was left out: the title of a duplicate to that of the job which stands for it.

    Of the same jobs a complete one is kept, else a failed one. Args: jobs of any number of sweeps.
    """
    kept: dict[str, SweepJob] = {}
    rank = {COMPLETE: 0, FAILED: 1, MISSING: 2}
    for job in jobs:
        best = kept.get(job.identity, job)
        kept[job.identity] = job if rank[job.status] < rank[best.status] else best
    return list(kept.values()), {job.title: kept[job.identity].title for job in jobs if kept[job.identity] is not job}


def coverage(jobs: Sequence[SweepJob], duplicates: Mapping[str, str]) -> SweepCoverage:
    """How many there are. Args: jobs, each once; duplicates, see `unique`."""
    complete, failed, missing = (sum(job.status == s for job in jobs) for s in (COMPLETE, FAILED, MISSING))
    return SweepCoverage(len(jobs), complete, failed, missing, len(duplicates))


def at(config: Any, key: str) -> Any:
    """The value of a dotted key, None where there is none. Args: config, nested; key."""
    for name in key.split("."):
        config = config.get(name) if isinstance(config, Mapping) else None
    return config


def _read(path: Path) -> dict[str, Any]:
    try:
        found = json.loads(files.content(path).decode("utf-8"))
    except json.JSONDecodeError as error:
        raise FileError(f"{path}, line {error.lineno}, column {error.colno}: is no JSON ({error.msg})") from error
    except (UnicodeDecodeError, RecursionError) as error:
        raise FileError(f"{path}: is no JSON") from error
    if not isinstance(found, dict):
        raise FileError(f"{path}: must hold entries by name, not {type(found).__name__}")
    return found


def _of(path: Path, plan: dict[str, Any], name: str, kind: type, default: Any = None) -> Any:
    value = plan.get(name, default)
    if not isinstance(value, kind):
        raise FileError(f"{path}: its entry '{name}' is missing or no {kind.__name__}: is it the plan of a sweep?")
    return value
