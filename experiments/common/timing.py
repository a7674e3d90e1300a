"""How long calls take, on the clock and with their results there."""

import statistics
import time
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import jax

T = TypeVar("T")


def timed(call: Callable[..., T], *arguments: Any) -> tuple[float, T]:
    """Seconds of one call, and its result."""
    began = time.perf_counter()
    result = jax.block_until_ready(call(*arguments))
    return time.perf_counter() - began, result


def seconds(call: Callable[..., Any], *arguments: Any) -> float:
    """Seconds of one call."""
    return timed(call, *arguments)[0]


def median(call: Callable[..., Any], *arguments: Any, runs: int) -> float:
    """Median of the seconds of so many calls."""
    return statistics.median(seconds(call, *arguments) for _ in range(runs))


def medians(calls: Mapping[str, Callable[[], Any]], runs: int, block: int = 5) -> dict[str, float]:
    """Median of the warm seconds of each call, so many blocks of each, in turns.

    In turns, so that what else the machine does falls on all; in blocks, so that each finds its own data in the caches.
    """
    samples: dict[str, list[float]] = {name: [] for name in calls}
    for call in calls.values():
        seconds(call)
    for _ in range(runs):
        for name, call in calls.items():
            samples[name] += [seconds(call) for _ in range(block)]
    return {name: statistics.median(values) for name, values in samples.items()}
