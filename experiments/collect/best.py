"""The values of a job as a parameter file."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from experiments.collect.arguments import quoted
from experiments.collect.axes import is_number
from experiments.collect.sweeps import SweepJob, SweepPlan, at
from urbanjax.io.runs.parameter_file import write_parameters
from urbanjax.io.runs.sweeps.plan import overridden
from urbanjax.rollout import LoopParams
from urbanjax.types import config
from urbanjax.types.unread import changed

MEANT = ("null", "true", "false", "nan", "inf")  # texts that Hydra takes for something else
FROM_ELSEWHERE = "${"  # a value that is looked up when a run begins, such as one of the environment


def values_of(job: SweepJob, planned: Mapping[str, Any]) -> dict[str, Any]:
    """What a job sets of a closed loop and does not leave at its default, and the dotted numbers that it overrides.

    What a parameter file of its own has brought belongs to it. Args: job; planned, the config of all jobs, before that.
    """
    defaults = config.schema(LoopParams)
    loop = {name: value for name, value in job.config.items() if name in defaults}
    keys = [*changed(loop, defaults), *changed(job.config, overridden(planned, job.overrides))]
    values = {key: at(job.config, key) for key in keys}
    values |= {key: value for key, value in job.overrides.items() if "." in key and is_number(value)}
    return {key: value for key, value in values.items() if _can_be_written(value)}


def _can_be_written(value: Any) -> bool:
    held = value if isinstance(value, list) else [value]
    return all(is_number(v) or isinstance(v, bool) or (isinstance(v, str) and FROM_ELSEWHERE not in v) for v in held)


def write_best(path: Path, job: SweepJob, *, scores: Sequence[str], plan: SweepPlan) -> None:
    """Write the parameter file of a job. Args: path; job; scores in words; plan of its sweep."""
    import shlex

    values = values_of(job, plan.config)
    rest = [shlex.quote(text) for text in plan.fixed if not text.startswith("params=")]
    rest += [override(key, value) for key, value in job.overrides.items() if key not in (*values, "params")]
    drive = ["python -m", f"experiments.{job.experiment}", f"params={os.path.relpath(path)}", *rest]
    about = {
        "sweep": job.sweep,
        "job": job.name,
        "score": "; ".join(scores),
        "sweep's command": plan.command or "-",
        "drive it with": " ".join(drive),
        "code": job.code,
    }
    write_parameters(path, values, about=about)


def override(key: str, value: Any) -> str:
    """An override as it is typed. Args: key, dotted; value, plain."""
    import shlex

    return shlex.quote(f"{key}={_typed(value)}")


def _typed(value: Any) -> str:
    if isinstance(value, list):
        return f"[{','.join(map(_typed, value))}]"
    if isinstance(value, dict):
        return "{" + ",".join(f"{name}: {_typed(held)}" for name, held in value.items()) + "}"
    if isinstance(value, str):
        return value if value.isidentifier() and value.lower() not in MEANT else quoted(value)
    return "null" if value is None else str(value).lower() if isinstance(value, bool) else repr(value)
