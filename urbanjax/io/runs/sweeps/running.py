"""A sweep from its plan to its report, whoever does its jobs."""

import contextlib
import dataclasses
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from urbanjax.io.runs import interpolation, parameter_file, program
from urbanjax.io.runs.directory import COMPLETE, FAILED
from urbanjax.io.runs.disk import SWEEP_KEY, is_of_disk, of_disk
from urbanjax.io.runs.processes import OWN
from urbanjax.io.runs.sweeps import plan
from urbanjax.io.runs.sweeps.axes import Axis
from urbanjax.io.runs.sweeps.code import state_of
from urbanjax.io.runs.sweeps.plan import PlannedJob, SweepDesign
from urbanjax.types import UrbanJaxError

MOST = 300  # characters of an error
GROUPS = ("preset",)  # keys that choose among files


def configs_of(task: program.Program, config: Any, *, keys: Sequence[str]) -> tuple[dict[str, Any], dict[str, Any]]:
    """The config of all jobs before their overrides: with its interpolations, and resolved.

    Args: task, the program; config, composed for the whole sweep; keys, that are swept.
    """
    from omegaconf import OmegaConf

    own: Any = program.own(config)
    for key in keys:
        if key not in GROUPS and OmegaConf.select(own, key, throw_on_missing=False) is not None:
            OmegaConf.update(own, key, None, force_add=True)
    return interpolation.plain(own, resolve=False), content_of(task, own)


def content_of(task: program.Program, config: Any) -> dict[str, Any]:
    """The values of a config that its results depend on, and what lies in the files that it names.

    Args: task, the program; config, composed.
    """
    values = interpolation.plain(program.own(config), resolve=True)
    return {name: _content(task, name, value) for name, value in values.items() if name not in OWN}


def contents_of(
    task: program.Program,
    axes: Sequence[Axis],
    *,
    jobs: Sequence[Mapping[str, Any]],
    base: Mapping[str, Any],
    groups: Mapping[str, Mapping[str, Any]],
) -> list[dict[str, Any]]:
    """What each job computes.

    Args: task, the program; axes; jobs, the overrides of each; base, the content of what they share; groups, the
    content that each choice of a config group makes of it, by key and `repr` of the choice.
    """
    resolved = interpolation.resolved({axis.key: list(axis.values) for axis in axes})
    known = {
        axis.key: {
            repr(value): _content(task, axis.key, found) for value, found in zip(axis.values, values, strict=True)
        }
        for axis, values in zip(axes, resolved.values(), strict=True)
    }
    found = []
    for job in jobs:
        composed = next((groups[key][repr(job[key])] for key in groups), base)
        values = {key: known[key][repr(value)] for key, value in job.items() if key not in groups and key not in OWN}
        found.append(plan.overridden(composed, values))
    return found


def _content(task: program.Program, name: str, value: Any) -> Any:
    """What a value comes to: what it is, or what lies in the file of that name."""
    if name == parameter_file.KEY:
        return parameter_file.read_parameters(Path(value)) if value else {}
    return [value, state_of(value)] if value and name in _paths(task.params_class) else value


def _paths(params_class: Any) -> set[str]:
    return {spec.name for spec in dataclasses.fields(params_class) if spec.metadata.get("path")}


def run(
    planned: SweepDesign,
    folder: Path,
    *,
    launch: Callable[[Sequence[PlannedJob]], None],
    report: Callable[[Path], Any],
    process: int = 0,
) -> None:
    """Have the jobs done that are left, and report on all.

    Args: planned, the sweep; folder, its directory; launch, does jobs; report, of a directory; process, number of this
    one where several share the jobs: the first one plans and reports. Raises UrbanJaxError where jobs have failed or
    are missing, after the report.
    """
    plan.check_folder(folder)
    first = process == 0
    with plan.held(folder, wait=False) if first else contextlib.nullcontext():
        if first:
            _planned(planned, folder)
        left = [job for job in planned.jobs if plan.status_of(folder / job.name) != COMPLETE]
        done = f", {len(planned.jobs) - len(left)} of them done before" if len(left) < len(planned.jobs) else ""
        print(f"sweep {planned.sweep}: {len(planned.jobs)} jobs{done}, in {folder}", flush=True)
        error = _launched(launch, left, folder)
        unreported = _reported(report, folder) if first else ""
    if not first:
        if error:
            raise UrbanJaxError(f"process {process}: {error}")
        return
    print(f"run directory: {os.path.relpath(folder)}", flush=True)
    error = "; ".join(dict.fromkeys(filter(None, (error, unreported))))
    states = {job.name: plan.status_of(folder / job.name) for job in planned.jobs}
    failed = [name for name, state in states.items() if state == FAILED]
    missing = [name for name, state in states.items() if state is None]
    if error and not failed and not missing:
        raise UrbanJaxError(
            f"all {len(states)} jobs are done, but not all is written [{error}]: give the command again"
        )
    if failed or missing:
        told = [f"{len(failed)} failed ({_some(failed)})"] * bool(failed)
        told += [f"{len(missing)} are missing ({_some(missing)})"] * bool(missing)
        why = f" [{error}]" if error else ""
        raise UrbanJaxError(
            f"of {len(states)} jobs {' and '.join(told)}{why}; the same command goes on with them"
            + ("" if unreported else f", {folder}/report.html says why")
        )


def _planned(planned: SweepDesign, folder: Path) -> None:
    try:
        planned.write(folder)
    except OSError as error:
        if not is_of_disk(error):
            raise
        raise UrbanJaxError(of_disk(error, folder, keys=[SWEEP_KEY])) from error


def _launched(launch: Callable[[Sequence[PlannedJob]], None], left: Sequence[PlannedJob], folder: Path) -> str:
    """Have jobs done; returns what ended them early. A mistake in what is asked is raised."""
    try:
        if left:
            launch(left)
    except UrbanJaxError:
        raise
    except Exception as error:
        said = " ".join(str(error).split())[:MOST]
        return of_disk(error, folder, keys=[SWEEP_KEY]) if is_of_disk(error) else f"{type(error).__name__}: {said}"
    return ""


def _reported(report: Callable[[Path], Any], folder: Path) -> str:
    """Report; returns why that was not possible on this disk."""
    try:
        report(folder)
    except OSError as error:
        if not is_of_disk(error):
            raise
        return of_disk(error, folder, keys=[SWEEP_KEY])
    return ""


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")
