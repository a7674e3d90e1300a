"""What a sweep asks of each key, and the jobs that come of it.

A value that is a text of the form `linspace:LOW:HIGH:N` stands for several, and needs no quotes in a shell:

    linspace:LOW:HIGH:N    N values, evenly spaced, both ends among them
    logspace:LOW:HIGH:N    the same in the logarithm; LOW and HIGH are values, not exponents
    sobol:LOW:HIGH:N       N values of a scrambled Sobol sequence (Owen 1998), `:log` behind it: in the logarithm
    lhs:LOW:HIGH:N         the same of a Latin hypercube (McKay et al. 1979)

All keys of `sobol`, and all of `lhs`, share one sample: job i has value i of each. Everything else is crossed.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from urbanjax.types import ConfigError, host_record

GRIDS, SAMPLES = ("linspace", "logspace"), ("sobol", "lhs")
MOST = 10**6  # jobs of a sweep
FORM = "KIND:LOW:HIGH:N with KIND one of linspace, logspace, sobol, lhs, such as linspace:0:1:32"


@host_record
class Axis:
    """One key of a sweep and its values."""

    key: str
    kind: str  # choice, linspace, logspace, sobol or lhs
    values: tuple[Any, ...]
    log: bool = False
    low: float | None = None  # the range asked for; of a choice there is none
    high: float | None = None

    @property
    def joint(self) -> str:
        """What it is sampled with; its key where it is crossed with everything."""
        return self.kind if self.kind in SAMPLES else f"={self.key}"


@host_record
class _Range:
    kind: str
    low: float
    high: float
    count: int
    log: bool


def axes_of(asked: Mapping[str, Sequence[Any]], *, seed: int = 0) -> list[Axis]:
    """The axes of a sweep, in the order of the keys.

    Args: asked, the values of each key, any of them a text as above; seed of what is drawn. Raises ConfigError for a
    text that is nearly of that form, a range that there is not, samples of different lengths, and a key without values.
    """
    found = {key: _axis(key, values) for key, values in asked.items()}
    drawn = {}
    for kind in SAMPLES:
        ranges = {key: one for key, one in found.items() if isinstance(one, _Range) and one.kind == kind}
        counts = {key: one.count for key, one in ranges.items()}
        if len(set(counts.values())) > 1:
            told = ", ".join(f"{key} has {n}" for key, n in counts.items())
            raise ConfigError(f"all keys of {kind!r} share one sample: give them one length ({told})")
        if ranges:
            unit = _sample(kind, next(iter(counts.values())), len(ranges), seed)
            drawn |= {
                key: Axis(key, kind, tuple(_scaled(unit[:, k], one)), one.log, one.low, one.high)
                for k, (key, one) in enumerate(ranges.items())
            }
    return [drawn.get(key, one) for key, one in found.items()]


def stands_for_several(value: Any) -> bool:
    """Whether a value is a text that stands for several values. Args: value, of a key."""
    return isinstance(value, str) and value.partition(":")[0] in (*GRIDS, *SAMPLES) and ":" in value


def jobs_of(axes: Sequence[Axis]) -> list[dict[str, Any]]:
    """The values of every job by key: what is sampled together stays together, all else is crossed, last key fastest.

    Args: axes, of the sweep. Raises ConfigError for more jobs than anybody waits for.
    """
    groups: dict[str, list[Axis]] = {}
    for axis in axes:
        groups.setdefault(axis.joint, []).append(axis)
    count = math.prod(len(group[0].values) for group in groups.values())
    if count > MOST:
        raise ConfigError(f"the sweep has {count} jobs, more than {MOST}: ask fewer values")
    rows = [
        [dict(zip([axis.key for axis in group], values, strict=True)) for values in _rows(group)]
        for group in groups.values()
    ]
    found = [{key: value for part in parts for key, value in part.items()} for parts in itertools.product(*rows)]
    return [{axis.key: job[axis.key] for axis in axes} for job in found]


def _rows(group: Sequence[Axis]) -> list[tuple[Any, ...]]:
    return list(zip(*(axis.values for axis in group), strict=True))


def _axis(key: str, values: Sequence[Any]) -> Axis | _Range:
    """One key; the only value of a sample's key is its range until all of them are known."""
    if not values:
        raise ConfigError(f"'{key}' has no values to sweep over: give at least one")
    if any(isinstance(value, float) and not math.isfinite(value) for value in values):
        raise ConfigError(f"'{key}' has a value that is not finite: leave it out")
    ranges = [_range(key, value) for value in values]
    if len(values) == 1 and (one := ranges[0]) is not None:
        return one if one.kind in SAMPLES else _spaced(key, one)
    if any(one is not None and one.kind in SAMPLES for one in ranges):
        raise ConfigError(f"'{key}' mixes a sample with other values: a sample stands alone")
    found = [_grid(one) if one is not None else [value] for one, value in zip(ranges, values, strict=True)]
    return Axis(key, "choice", tuple(itertools.chain.from_iterable(found)))


def _spaced(key: str, one: _Range) -> Axis:
    return Axis(key, one.kind, tuple(_grid(one)), one.log, one.low, one.high)


def _range(key: str, value: Any) -> _Range | None:
    """The range that a text stands for, None where it is no such text."""
    if not stands_for_several(value):
        return None
    kind, *rest = value.split(":")
    log = kind in SAMPLES and rest[-1] == "log"
    try:
        low, high, count = float(rest[0]), float(rest[1]), int(rest[2])
    except (IndexError, ValueError) as error:
        raise ConfigError(f"{key}={value}: write {FORM}") from error
    if len(rest) != 3 + log or count < 1 or not math.isfinite(low) or not math.isfinite(high):
        raise ConfigError(f"{key}={value}: write {FORM}")
    if count > MOST:
        raise ConfigError(f"{key}={value}: more than {MOST} values: ask fewer")
    log = log or kind == "logspace"
    if low >= high and (count > 1 or low > high):
        raise ConfigError(f"{key}={value}: {rest[0]} is not below {rest[1]}: write the smaller end first")
    if log and low <= 0:
        raise ConfigError(f"{key}={value}: the logarithm needs ends above 0")
    return _Range(kind, low, high, count, log)


def _grid(one: _Range) -> list[float]:
    spaced = np.geomspace if one.log else np.linspace
    return spaced(one.low, one.high, one.count).tolist()


def _sample(kind: str, count: int, size: int, seed: int) -> np.ndarray:
    """Points [count, size] in the unit cube."""
    from scipy.stats import qmc

    if kind == "lhs":
        return qmc.LatinHypercube(size, rng=seed).random(count)
    powers = math.ceil(math.log2(count))  # a sequence is balanced at powers of two: it is drawn up to the next one
    return qmc.Sobol(size, rng=seed).random_base2(powers)[:count]


def _scaled(unit: np.ndarray, one: _Range) -> list[float]:
    if one.log:
        return np.exp(math.log(one.low) + unit * (math.log(one.high) - math.log(one.low))).tolist()
    return (one.low + unit * (one.high - one.low)).tolist()
