"""Jobs of a sweep as one evaluation: those that differ in values of their parameters alone share programs."""

import copy
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from urbanjax.io.runs import compile_cache, evaluations, interpolation, processes
from urbanjax.io.runs.directory import COMPLETE, Run
from urbanjax.io.runs.disk import is_of_disk
from urbanjax.io.runs.evaluations import Evaluation
from urbanjax.io.runs.program import Program, fail, job_run, own, taken
from urbanjax.types import ConfigError, ProcessError, UrbanJaxError, host_record


@host_record
class BatchedJob:
    """One job."""

    folder: Path
    config: Any  # composed
    keys: Sequence[str]  # that somebody set


def changed_config(config: Any, values: Mapping[str, Any]) -> Any:
    """A composed config with some values changed. Args: config; values by dotted key, of keys that it has.

    Raises ConfigError for a key that it does not have.
    """
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    changed = copy.deepcopy(config)
    for key, value in values.items():
        try:
            OmegaConf.update(changed, key, value, merge=True)
        except OmegaConfBaseException as error:
            raise ConfigError(f"cannot set '{key}': {str(error).splitlines()[0]}") from error
    return changed


def do(program: Program, jobs: Sequence[BatchedJob]) -> None:
    """Do the jobs; what one raises is said in its manifest, and ends nothing else.

    Args: program, of an experiment that evaluates; jobs. Raises ConfigError for any other experiment, OSError for a
    disk that takes nothing any more, and UrbanJaxError in a process that follows, for jobs that have failed in it.
    """
    if program.evaluation is None:
        raise ConfigError(
            f"'{program.name}' evaluates no drives, which is what hydra/launcher=vmap batches: ask for "
            "hydra/launcher=basic or hydra/launcher=joblib"
        )
    config = interpolation.plain(own(jobs[0].config), resolve=True)
    if not processes.shared(config):
        _do(program, jobs)
        return
    for job in jobs if not processes.follows(config) else ():
        processes.forget_failures(job.folder)
    with processes.together(config) as line:
        line.remedy = "what has been computed is kept; start all processes again with the same command"
        told = _do(program, jobs)
    if told:
        raise UrbanJaxError(f"failed in this process: job {', job '.join(told)}; the first one lists it")


def _do(program: Program, jobs: Sequence[BatchedJob]) -> list[str]:
    """Do the jobs; returns the names of those that have failed here, where another process is to list them."""
    assert program.evaluation is not None
    runs: dict[str, Run] = {}
    begun: dict[str, Evaluation] = {}
    waiting: list[str] = []
    told: list[str] = []  # to the first process, by this one
    for job in jobs:
        runs[job.folder.name] = run = job_run(job.folder, job.config)
        try:
            asked = taken(run, program.read(job.config, job.config.hydra, keys=job.keys))
            begun[job.folder.name] = program.evaluation(asked.params, run)
        except Exception as error:
            told += _fail(run, error)

    def ended(name: str, error: Exception | None) -> None:
        if error is not None:
            told.extend(_fail(runs[name], error))
        elif processes.shared(runs[name].resolved):
            waiting.append(name)  # others drive their share of it at the same time
        else:
            told.extend(_finish(runs[name], begun.pop(name)))

    with compile_cache.kept(next(iter(runs.values())), anew=program.anew):
        evaluations.evaluate(begun, ended=ended, title="sweep")
    for name in waiting:
        told += _finish(runs[name], begun.pop(name))
    return told


def _finish(run: Run, evaluation: Evaluation) -> list[str]:
    """Write what a job comes to; returns its name where that fails and is for the first process to list."""
    try:
        evaluation.finish()
        if not processes.follows(run.resolved):
            run.finish(COMPLETE)
    except Exception as error:
        return _fail(run, error)
    return []


def _fail(run: Run, error: Exception) -> list[str]:
    """Say what a job has raised; returns its name where that is for the first process to list."""
    if is_of_disk(error) or isinstance(error, ProcessError):
        raise error
    if processes.follows(run.resolved):
        processes.tell_failure(run, error)
        return [run.directory.name]
    fail(run, error)
    return []
