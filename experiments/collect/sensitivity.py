"""Which axes decide a score: indices from a sample of all of them at once."""

import contextlib
import warnings
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from experiments.collect.axes import SweepAxis
from experiments.collect.scores import Evidence
from experiments.collect.sweeps import SweepJob
from urbanjax.evaluation.statistics import WithInterval
from urbanjax.types import host_record

LEAST = 30  # jobs: of fewer the indices are mostly noise
RESAMPLES, SEED, PER_BIN = 200, 1, 10


@host_record
class AxisIndex:
    """How much an axis decides of a score, with 95 % intervals."""

    axis: SweepAxis
    first_order: WithInterval  # share of the variance that goes with it alone (Sobol's S1)
    delta: WithInterval  # Borgonovo's: how far knowing it moves the distribution, 0 to 1


def indices(axes: Sequence[SweepAxis], jobs: Sequence[SweepJob], *, evidence: Evidence, name: str) -> list[AxisIndex]:
    """The indices of all numeric axes from given data (Plischke, Borgonovo and Smith 2013), the greatest first.

    None where nothing was sampled, of fewer than LEAST jobs, and of a score that is the same in all.
    Args: axes; jobs; evidence of them; name of the score.
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
    return WithInterval(float(value), float(value - half), float(value + half))


def _delta(at: np.ndarray, score: np.ndarray) -> dict[str, Any]:
    """SALib's analysis of given data: at [jobs, axes], score [jobs]."""
    names = [f"x{i}" for i in range(at.shape[1])]
    bins = max(2, min(10, len(score) // PER_BIN))  # of fewer jobs in each it refuses
    with _as_before():
        from SALib.analyze import delta

        return delta.analyze(
            {"num_vars": len(names), "names": names, "bounds": [[0.0, 1.0]] * len(names)},
            at,
            score,
            num_resamples=RESAMPLES,
            seed=SEED,
            bins_specs=dict.fromkeys(names, bins),
        )


@contextlib.contextmanager
def _as_before() -> Iterator[None]:
    """SALib seeds NumPy's global generator, and changes how warnings are shown: neither outlives the call."""
    state, shown = np.random.get_state(), warnings.formatwarning  # noqa: NPY002
    try:
        with warnings.catch_warnings(record=True):
            warnings.simplefilter("ignore")
            yield
    finally:
        np.random.set_state(state)  # noqa: NPY002
        warnings.formatwarning = shown
