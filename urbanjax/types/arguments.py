"""What a caller from outside may have got wrong: numbers that are none, and records of another kind."""

import dataclasses
import math
from collections.abc import Mapping
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


def whole(value: Any, name: str, *, error: type[UrbanJaxError], least: int, most: int | None = None) -> int:
    """The value as an int. Raises `error`, in one line, for anything else.

    Args: value, as given; name, for the message; error, its class; least and most, that it may be.
    """
    plain = isinstance(value, int | np.integer) and not isinstance(value, bool)
    scalar = isinstance(value, np.ndarray | jax.Array) and not traced(value) and value.dtype.kind in "iu"
    known = plain or (scalar and np.ndim(value) == 0)
    if not known or value < least or (most is not None and value > most):
        bounds = f"at least {least}" if most is None else f"between {least} and {most}"
        raise error(f"{name} is {short(value)}: it must be a whole number, {bounds}")
    return int(value)


def kind(value: Any, name: str, *, wanted: type | tuple[type, ...], error: type[UrbanJaxError]) -> None:
    """Raise `error`, in one line, where the value is of another class; says where it holds one that would do.

    Args: value, as given; name, for the message; wanted, the class or classes; error, its class.
    """
    if not isinstance(value, wanted):
        names = " or ".join(
            one.__name__.rpartition(".")[2] for one in (wanted if isinstance(wanted, tuple) else (wanted,))
        )
        specs = dataclasses.fields(value) if dataclasses.is_dataclass(value) else ()
        held = next((spec.name for spec in specs if isinstance(getattr(value, spec.name, None), wanted)), None)
        instead = "" if held is None else f", here its .{held}"
        raise error(f"{name} is a {type(value).__name__}: give a {names}{instead}")


def kinds(given: Mapping[str, tuple[Any, type]], *, error: type[UrbanJaxError]) -> None:
    """`kind` of several. Args: given, values and the classes they should be of, by name; error, its class."""
    for name, (value, wanted) in given.items():
        kind(value, name, wanted=wanted, error=error)


def array(value: Any, name: str, *, error: type[UrbanJaxError]) -> np.ndarray:
    """The value as a float64 array. Raises `error`, in one line, where it holds no real numbers.

    Args: value, as given; name, for the message; error, its class.
    """
    try:
        if np.ma.is_masked(value):
            raise error(
                f"{name}: some of it is masked, which would be taken as it stands: leave it out (.compressed())"
            )
        found = np.asarray(value)
        if found.dtype.kind not in "fiu":
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
