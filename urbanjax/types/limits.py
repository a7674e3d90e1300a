"""What the values of a params class may be: stated beside its fields, checked wherever one is made."""

import dataclasses
import math
import typing
from typing import Any, NamedTuple

import numpy as np

from urbanjax.types.arguments import short
from urbanjax.types.errors import ConfigError
from urbanjax.types.kinds import Kinds, kinds_of, ought

TINY = float(np.finfo(np.float32).tiny)  # the least positive number that is no zero in single precision
NEXT = float(np.nextafter(np.float32(1), np.float32(0)))  # and the greatest below 1
# Metadata of a field, both ends included.
SHARE = {"range": (0.0, 1.0)}
INSIDE = {"range": (TINY, NEXT)}  # a share that is neither nothing nor all
POSITIVE = {"range": (TINY, math.inf)}  # of what is divided by
SEED = {"range": (0, 2**32 - 1)}  # beyond, JAX takes another seed's numbers or none


class FieldLimits(NamedTuple):
    """What one field of a class states of its values, and of each of them in a tuple."""

    name: str
    choices: tuple | None
    bounds: tuple | None  # least and greatest
    kinds: Kinds | None = None  # as annotated


def limits_of(spec: dataclasses.Field) -> FieldLimits:
    """What a field states of its values. Args: spec, of a params class."""
    literal = typing.get_args(spec.type) if typing.get_origin(spec.type) is typing.Literal else None
    return FieldLimits(spec.name, literal or spec.metadata.get("choices"), spec.metadata.get("range"), kinds_of(spec))


def stated_limits(params_class: type) -> list[FieldLimits]:
    """Those of all fields that state any; of which kind a value is matters where every field has a default.

    Args: params_class, a dataclass.
    """
    specs = dataclasses.fields(params_class)
    missing = dataclasses.MISSING
    whole = all(spec.default is not missing or spec.default_factory is not missing for spec in specs)
    limits = [each if whole else each._replace(kinds=None) for each in map(limits_of, specs)]
    return [each for each in limits if each.choices or each.bounds or each.kinds]


def instead(value: Any, *, choices: tuple | None, bounds: tuple | None) -> str:
    """What `value` should be, as in "between 0 and 1"; empty where it may be what it is.

    Args: value, one text, switch or number; choices, if only they are allowed; bounds, least and greatest, if any.
    """
    if choices and not any(isinstance(value, type(choice)) and value == choice for choice in choices):
        return f"one of {', '.join(map(str, choices))}"
    low, high = bounds or (-math.inf, math.inf)
    if bounds is None or low <= value <= high:
        return ""
    if high == math.inf:
        return "positive" if low == TINY else f"at least {low:g}"
    if (low, high) == INSIDE["range"]:
        return "above 0 and below 1"
    if isinstance(high, int) and high > 1e6:
        return f"between {low} and {high}"
    return f"between {low:g} and {high:g}"


def check(params: Any, limits: list[FieldLimits]) -> None:
    """Raise ConfigError for the first value that is not what its field says.

    Numbers and NumPy arrays are looked at; what JAX holds is not, since it may be traced or would have to be waited
    for. Args: limits, of the class of the params.
    """
    for name, choices, bounds, kinds in limits:
        value = getattr(params, name)
        better = "" if kinds is None or choices else ought(value, kinds)
        if better:
            raise ConfigError(f"{type(params).__name__}.{name} is {short(value)}: it must be {better}")
        several = isinstance(value, tuple | list) and (kinds is None or kinds.several)
        for item in value if several else (value,):
            for one in (item,) if choices else _known(item):
                better = instead(one, choices=choices, bounds=bounds)
                if better:
                    better = f"use {better}" if choices else f"it must be {better}"
                    raise ConfigError(f"{type(params).__name__}.{name} is {short(one)}: {better}")


def _known(value: Any) -> tuple:
    """The numbers that decide whether `value` is within bounds."""
    if isinstance(value, int | float):
        return (value,)
    if isinstance(value, np.ndarray | np.number) and value.dtype.kind in "iuf" and value.size:
        return value.min().item(), value.max().item()
    return ()
