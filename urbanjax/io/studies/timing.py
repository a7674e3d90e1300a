"""How long calls take, on the clock and with their results there."""

import statistics
import time
from collections.abc import Callable
from typing import Any

import jax


def seconds(call: Callable[..., Any], *arguments: Any) -> float:
    """Seconds of one call."""
    began = time.perf_counter()
    jax.block_until_ready(call(*arguments))
    return time.perf_counter() - began


def median(call: Callable[..., Any], *arguments: Any, runs: int) -> float:
    """Median of the seconds of so many calls."""
    return statistics.median(seconds(call, *arguments) for _ in range(runs))
