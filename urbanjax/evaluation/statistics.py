"""How sure a number over runs is: Wilson intervals of rates, bootstrap intervals of everything else (host side)."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from urbanjax.types import ScenarioError

LEVEL, DRAWS = 0.95, 2000
AT_ONCE = 10**7  # numbers held while drawing


class WithInterval(NamedTuple):
    """A number over runs and the ends of its interval; NaN throughout where there are no runs."""

    value: float
    low: float
    high: float

    @property
    def percent(self) -> "WithInterval":
        """A share in percent."""
        return WithInterval(*(100 * x for x in self))

    def flat(self, name: str) -> dict[str, float]:
        """As entries of a summary: `name`, `name_low` and `name_high`. Args: name with unit."""
        return {name: self.value, f"{name}_low": self.low, f"{name}_high": self.high}

    def text(self, digits: int = 1) -> str:
        """As a cell of a table: 98.6 [92.3, 99.7]. Args: digits after the point."""
        if np.isnan(self.value):
            return "-"
        value, low, high = (f"{x:.{digits}f}" for x in self)
        return value if np.isnan(self.low) else f"{value} [{low}, {high}]"


def rate(happened: Sequence[Any] | np.ndarray, *, level: float = LEVEL) -> WithInterval:
    """The share of runs in which something happened, with its Wilson score interval (Wilson 1927).

    Args: happened [N], one truth value per run; level, nominal coverage.
    """
    found = np.asarray(happened, bool)
    if not found.size:
        return WithInterval(np.nan, np.nan, np.nan)
    ends = stats.binomtest(int(found.sum()), found.size).proportion_ci(level, method="wilson")
    return WithInterval(float(found.mean()), float(ends.low), float(ends.high))


def mean(values: Any, *, groups: Any = None, level: float = LEVEL, seed: int = 0) -> WithInterval:
    """The mean over runs with its bootstrap interval.

    Args: values [N], finite; groups [N], what each run belongs to (default: every run stands alone); level, nominal
    coverage; seed of the draws.
    """
    numbers = np.asarray(values, float)
    which = _grouped(len(numbers), groups)
    if len(numbers) < 2:
        return WithInterval(float(numbers.mean()) if len(numbers) else np.nan, np.nan, np.nan)
    size, total = np.bincount(which), np.bincount(which, numbers)
    rng, drawn, rows = np.random.default_rng(seed), [], max(AT_ONCE // len(size), 1)
    for first in range(0, DRAWS, rows):
        chosen = rng.integers(0, len(size), (min(rows, DRAWS - first), len(size)))
        drawn.append(total[chosen].sum(1) / size[chosen].sum(1))
    return _between(float(numbers.mean()), np.concatenate(drawn), level)


def median(values: Any, *, level: float = LEVEL) -> WithInterval:
    """The median over runs, between two of its order statistics (Thompson 1936); values may be infinite.

    Of fewer than six runs these are the least and greatest, which hold it with less than 95 %: five with 94 %.
    Args: values [N]; level, coverage at least.
    """
    found = np.sort(np.asarray(values, float))
    if len(found) < 2:
        return WithInterval(float(found[0]) if len(found) else np.nan, np.nan, np.nan)
    k = max(int(stats.binom.ppf((1 - level) / 2, len(found), 0.5)), 1)  # [k-th, N + 1 - k-th]
    lower, upper = found[(len(found) - 1) // 2], found[len(found) // 2]
    middle = lower if lower == upper else (lower + upper) / 2
    return WithInterval(float(middle), float(found[k - 1]), float(found[-k]))


def bootstrap(
    statistic: Callable[[np.ndarray], float],
    count: int,
    *,
    groups: Any = None,
    level: float = LEVEL,
    draws: int = DRAWS,
    seed: int = 0,
) -> WithInterval:
    """A number over runs with its percentile bootstrap interval (Efron 1979); whole groups are drawn.

    Runs of one scene, or scans of one stretch, depend on each other: drawing them one by one would promise too much.
    With a single group its runs are drawn, since nothing else is left. The interval of fewer than two runs is NaN.
    Args: statistic, of the indices of some of the runs, with repeats (NaN where they say nothing); count, N runs;
    groups [N], what each belongs to (default: every run stands alone); level, nominal coverage; draws, their number;
    seed of the draws. Raises ScenarioError for another number of groups than of runs.
    """
    every, which = np.arange(count), _grouped(count, groups)
    if not count:
        return WithInterval(np.nan, np.nan, np.nan)
    value = float(statistic(every))
    if count < 2:
        return WithInterval(value, np.nan, np.nan)
    members = [np.flatnonzero(which == name) for name in range(which.max() + 1)]
    chosen = np.random.default_rng(seed).integers(0, len(members), (draws, len(members)))
    if len(members) == count:
        drawn = [statistic(row) for row in chosen]
    else:
        drawn = [statistic(np.concatenate([members[k] for k in row])) for row in chosen]
    return _between(value, np.asarray(drawn, float), level)


def _grouped(count: int, groups: Any) -> np.ndarray:
    """The number of the group of each run; where there is one group alone, each run is its own."""
    if groups is not None and len(groups) != count:
        raise ScenarioError(f"{len(groups)} groups for {count} runs: name the group of each run")
    if groups is None or not count:
        return np.arange(count)
    which = np.unique(np.asarray(groups), return_inverse=True)[1].ravel()
    return which if which.max() else np.arange(count)


def _between(value: float, drawn: np.ndarray, level: float) -> WithInterval:
    """A number with the quantiles of what was drawn of it."""
    known = drawn[~np.isnan(drawn)]
    if not known.size:
        return WithInterval(value, np.nan, np.nan)
    low, high = np.quantile(known, ((1 - level) / 2, (1 + level) / 2))
    return WithInterval(value, float(low), float(high))


def stretches(count: int, blocks: int = 40) -> np.ndarray:
    """Groups [N] of consecutive samples of one drive, as many in each. Args: count, N; blocks, their number."""
    return np.arange(count) * min(blocks, max(count, 1)) // max(count, 1)


def paired(ours: Any, theirs: Any, *, groups: Any = None, level: float = LEVEL, seed: int = 0) -> WithInterval:
    """The mean difference of runs that began alike, ours less theirs, with its bootstrap interval.

    Args: ours and theirs [N], of the same starts in the same order; groups [N], what each start belongs to; level,
    nominal coverage; seed of the draws. Raises ScenarioError for different numbers of runs.
    """
    one, other = np.asarray(ours, float), np.asarray(theirs, float)
    if one.shape != other.shape:
        raise ScenarioError(f"{one.size} and {other.size} runs are no pairs: compare the same starts")
    return mean(one - other, groups=groups, level=level, seed=seed)
