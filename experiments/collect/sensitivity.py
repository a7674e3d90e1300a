"""Which axes decide a score: indices from a sample of all of them at once."""

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from experiments.collect.axes import SweepAxis
from experiments.collect.scores import Evidence
from experiments.collect.sweeps import SweepJob
from urbanjax.evaluation.statistics import WithInterval
from urbanjax.types import UrbanJaxError, host_record

LEAST = 30  # jobs: of fewer the indices are mostly noise
RESAMPLES, SEED, PER_BIN = 100, 1, 10


@host_record
class AxisIndex:
    """How much an axis decides of a score, with 95 % intervals."""

    axis: SweepAxis
    first_order: WithInterval  # 0 to 1: share of the variance that goes with it alone (Sobol's S1)
    delta: WithInterval  # Borgonovo's: how far knowing it moves the distribution, 0 to 1


def indices(axes: Sequence[SweepAxis], jobs: Sequence[SweepJob], *, evidence: Evidence, name: str) -> list[AxisIndex]:
    """The indices of all numeric axes from given data (Plischke, Borgonovo and Smith 2013), the greatest first.

    None where nothing was sampled, of fewer than LEAST jobs, and of a score that is the same in all.
    Args: axes; jobs; evidence of them; name of the score. Raises UrbanJaxError where the library fails.
    """
    score = np.array([evidence.of(job, name).value for job in jobs])
    known = [job for job, value in zip(jobs, score, strict=True) if np.isfinite(value)]
    score = score[np.isfinite(score)]
    varied = [axis for axis in axes if axis.numeric and axis.varies]
    if len(known) < LEAST or not any(axis.sampled for axis in varied) or np.ptp(score) == 0:
        return []
    at = np.stack([axis.positions(known) for axis in varied], axis=1)
    found = _delta(at, score)
    rows = [
        zip(*(found[key] for key in keys), strict=True) for keys in (("S1", "S1_conf"), ("delta_raw", "delta_raw_conf"))
    ]
    told = [AxisIndex(axis, _within(*s1), _within(*delta)) for axis, s1, delta in zip(varied, *rows, strict=True)]
    return sorted(told, key=lambda index: -index.first_order.value)


def _within(value: float, half: float) -> WithInterval:
    """An estimate with its interval, both cut to what an index can be: the resamples know no ends."""
    return WithInterval(*(float(np.clip(end, 0.0, 1.0)) for end in (value, value - half, value + half)))


def _delta(at: np.ndarray, score: np.ndarray) -> dict[str, Any]:
    """SALib's analysis of given data: at [jobs, axes], score [jobs].

    In a process of its own: it seeds NumPy's global generator, changes how warnings are shown, and solves thousands of
    tiny systems, for each of which threads of BLAS would wait for each other.
    """
    bins = max(2, min(10, len(score) // PER_BIN))  # of fewer jobs in each it refuses
    told = {"at": at.tolist(), "score": score.tolist(), "bins": bins, "resamples": RESAMPLES, "seed": SEED}
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    command = [sys.executable, "-W", "ignore", "-c", PROGRAM]
    done = subprocess.run(command, input=json.dumps(told), env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        said = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
        raise UrbanJaxError(f"SALib has failed: {said[-1]}")
    return json.loads(done.stdout)


PROGRAM = """
import json, sys
import numpy as np
from SALib.analyze import delta
told = json.load(sys.stdin)
at, score = np.array(told["at"]), np.array(told["score"])
names = [f"x{i}" for i in range(at.shape[1])]
problem = {"num_vars": len(names), "names": names, "bounds": [[0.0, 1.0]] * len(names)}
bins = dict.fromkeys(names, told["bins"])
found = delta.analyze(problem, at, score, num_resamples=told["resamples"], seed=told["seed"], bins_specs=bins)
json.dump({key: found[key].tolist() for key in ("S1", "S1_conf", "delta_raw", "delta_raw_conf")}, sys.stdout)
"""
