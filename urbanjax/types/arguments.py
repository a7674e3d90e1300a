"""What a caller from outside may have got wrong: numbers that are none, and records of another kind."""

import math
from typing import Any

import jax
import numpy as np

from urbanjax.types.errors import UrbanJaxError


def number(value: Any, name: str, *, error: type[UrbanJaxError], positive: bool = True) -> float:
    """The value as a float. Raises `error`, in one line, for anything but a finite number.

    Args: value, as given; name, for the message; error, its class; positive, whether it has to be.
    """
    try:
        known = float("nan") if isinstance(value, bool | str) or np.ndim(value) else float(value)
    except (TypeError, ValueError):
        known = float("nan")
    if not math.isfinite(known) or (positive and known <= 0):
        raise error(f"{name} is {short(value)}: it must be a {'positive' if positive else 'finite'} number")
    return known


def whole(value: Any, name: str, *, error: type[UrbanJaxError], least: int) -> int:
    """The value as an int. Raises `error`, in one line, for anything else.

    Args: value, as given; name, for the message; error, its class; least, that it may be.
    """
    known = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not known or value < least:
        raise error(f"{name} is {short(value)}: it must be a whole number, at least {least}")
    return int(value)


def kind(value: Any, name: str, *, wanted: type | tuple[type, ...], error: type[UrbanJaxError]) -> None:
    """Raise `error`, in one line, where the value is of another class.

    Args: value, as given; name, for the message; wanted, the class or classes; error, its class.
    """
    if not isinstance(value, wanted):
        names = " or ".join(one.__name__ for one in (wanted if isinstance(wanted, tuple) else (wanted,)))
        raise error(f"{name} is a {type(value).__name__}: give a {names}")


def array(value: Any, name: str, *, error: type[UrbanJaxError]) -> np.ndarray:
    """The value as a float64 array. Raises `error`, in one line, where it holds no real numbers.

    Args: value, as given; name, for the message; error, its class.
    """
    try:
        found = np.asarray(value)
        if found.dtype.kind not in "fiub":
            raise TypeError
        return found.astype(np.float64)
    except (TypeError, ValueError) as wrong:
        raise error(f"{name}: {type(value).__name__} is no array of real numbers") from wrong


def traced(*trees: Any) -> bool:
    """Whether any leaf is being traced (jit, vmap, grad), so that nobody knows its value. Args: trees of arrays."""
    return any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(trees))


def short(value: Any) -> str:
    """The value as text for a line. Args: value of any kind."""
    text = repr(value).splitlines()[0] if repr(value) else ""
    return text if len(text) <= 60 else f"{text[:57]}..."
