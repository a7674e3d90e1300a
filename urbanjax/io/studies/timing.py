"""How long calls take, on the clock and with their results there."""

import statistics
import time
from collections.abc import Callable
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
