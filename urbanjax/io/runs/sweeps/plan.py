"""A sweep on disk: its plan is written first, every job has a directory, and a manifest there says that it is done."""

import contextlib
import fcntl
import json
import shlex
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from urbanjax.io.runs.directory import LOCK, MANIFEST, digest, versions, write_atomically
from urbanjax.io.runs.sweeps.axes import Axis
from urbanjax.io.runs.sweeps.code import code_digest, settings
from urbanjax.types import ConfigError, FileError, UrbanJaxError, host_record

FILE = "sweep.json"
LENGTH = 12  # hexadecimal digits of a name


@host_record
class PlannedJob:
    """One job of a sweep."""

    name: str
    overrides: dict[str, Any]
    content: str = ""  # hash of what it computes: the same for the same job of two sweeps


@host_record
class SweepDesign:
    """What a sweep consists of."""

    experiment: str
    sweep: str  # its name: the content of what it computes
    config: dict[str, Any]  # of all jobs, before their overrides
    axes: tuple[Axis, ...]
    jobs: tuple[PlannedJob, ...]
    fixed: tuple[str, ...] = ()  # overrides of all jobs, as typed

    def write(self, folder: Path) -> None:
        """Write the plan into the sweep's directory, where there is none. Args: folder, the directory."""
        if (folder / FILE).exists():
            return
        told = {
            "experiment": self.experiment,
            "sweep": self.sweep,
            "command": shlex.join(sys.orig_argv),
            "code": code_digest(),
            "versions": versions(),
            "axes": {one.key: _told(one) for one in self.axes},
            "fixed": list(self.fixed),
            "jobs": [{"name": one.name, "overrides": one.overrides, "content": one.content} for one in self.jobs],
            "config": self.config,
        }
        write_atomically(folder / FILE, json.dumps(told, indent=1) + "\n")


def _told(axis: Axis) -> dict[str, Any]:
    """An axis as plain values; its range, where one was asked for."""
    told = {"kind": axis.kind, "values": list(axis.values), "log": axis.log}
    return told if axis.low is None else {**told, "low": axis.low, "high": axis.high}


def plan_of(
    experiment: str,
    config: Mapping[str, Any],
    *,
    axes: Sequence[Axis],
    jobs: Sequence[dict[str, Any]],
    contents: Sequence[Any],
    fixed: Sequence[str] = (),
) -> SweepDesign:
    """The plan of a sweep; its name says what it computes: the values of all its jobs, the sources and the versions.

    Args: experiment, its name; config, of all jobs, with its interpolations; axes; jobs, the overrides of each;
    contents, what each computes, as plain values; fixed, the overrides of all, as typed.
    """
    about = [experiment, code_digest(), versions(), settings()]
    hashes = [digest({"content": [*about, content]}) for content in contents]
    name = digest({"content": hashes, "jobs": list(jobs)})[:LENGTH]
    named = tuple(
        PlannedJob(f"{k:05d}", overrides, content)
        for k, (overrides, content) in enumerate(zip(jobs, hashes, strict=True))
    )
    return SweepDesign(experiment, name, dict(config), tuple(axes), named, tuple(fixed))


def overridden(config: Mapping[str, Any], overrides: Mapping[str, Any]) -> dict[str, Any]:
    """A nested config with other values. Args: config, left as it is; overrides by dotted key."""
    out = dict(config)
    for key, value in overrides.items():
        name, _, rest = key.partition(".")
        held = out.get(name)
        out[name] = overridden(held if isinstance(held, Mapping) else {}, {rest: value}) if rest else value
    return out


def status_of(folder: Path) -> str | None:
    """How a job ended, None where it has not. Args: folder, its directory."""
    try:
        return json.loads((folder / MANIFEST).read_text(encoding="utf-8"))["status"]
    except (OSError, ValueError, KeyError, TypeError):
        return None


def job_in(folder: Path) -> tuple[str, PlannedJob]:
    """The name of the sweep, and the job as its plan has it.

    Args: folder, the job's directory. Raises FileError where the sweep has no plan, or one without this job.
    """
    path = folder.parent / FILE
    try:
        plan = json.loads(path.read_text(encoding="utf-8"))
        found = next(one for one in plan["jobs"] if one["name"] == folder.name)
        return plan["sweep"], PlannedJob(found["name"], found["overrides"])
    except (OSError, ValueError, KeyError, TypeError, StopIteration) as error:
        raise FileError(f"{path}: no plan of a sweep with a job {folder.name}; start the sweep anew") from error


@contextlib.contextmanager
def held(folder: Path, *, wait: bool) -> Iterator[None]:
    """Hold a directory alone among the processes of this machine; whoever ends, however, lets go of it.

    Args: folder, the directory; wait, for whoever holds it: without it that is an UrbanJaxError.
    """
    with open(folder / LOCK, "a", encoding="utf-8") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except BlockingIOError as error:
            raise UrbanJaxError(f"{folder}: another process is at this sweep; wait for it, or end it") from error
        yield


def check_folder(folder: Path) -> None:
    """Make a directory. Args: folder. Raises ConfigError where that cannot be."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"{folder}: {error.strerror or error}; set hydra.sweep.dir to another folder") from error
