"""Beside the params, what is known of each of their continuous numbers: may it be tuned, and within which bounds."""

import dataclasses
import functools
import re
from collections.abc import Iterator
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from urbanjax.tuning.transforms import scale_of, transform_of
from urbanjax.types import ConfigError, host_record
from urbanjax.types.arguments import short, traced
from urbanjax.types.config import bounds_of, default_of, stated
from urbanjax.types.fields_doc import comments_of
from urbanjax.types.pinned import fits, pinned
from urbanjax.types.unread import unread

ONE = r"(?:1/)?(?:m|s|rad)(?:\^\d)?(?:/(?:m|s|rad)(?:\^\d)?)?"
UNIT = re.compile(rf"(?:{ONE}|\[-\])(?: per (?:squared )?{ONE})?(?=$|[\s,;:])")


@host_record
class Trainable:
    """One continuous number of params: whether it may be tuned, and how."""

    key: str  # dotted; of an element of a tuple with its place: `offsets[3]`
    unit: str  # as the comment beside the field begins; empty where it states none
    value: float  # that it has
    low: float  # the least that it may be; minus infinity for none
    high: float  # the greatest; infinity for none
    transform: str  # from a free coordinate, a key of `transforms.TRANSFORMS`
    scale: float  # what a unit of that coordinate changes, at the value
    pinned: str = ""  # why it is fixed; empty where it may be tuned

    @property
    def field(self) -> str:
        """The key that a config and a parameter file know: of the whole tuple, for an element."""
        return re.sub(r"\[\d+\]$", "", self.key)

    @property
    def group(self) -> str:
        """The dotted key of the group that holds it."""
        return self.field.rpartition(".")[0]

    @property
    def tunable(self) -> bool:
        """Whether it may be tuned."""
        return not self.pinned


def trainables(params: Any) -> tuple[Trainable, ...]:
    """Each continuous number of params, in the order of their leaves.

    Bounds are what a config accepts: the range that the field states, or not below 0 where its default is positive.
    Fixed is what a class states as PINNED (`types.pinned`), and what nothing reads (UNREAD) in these params: with
    relaxed choices that is less. What is handed down is a number of whoever hands it down. Elements of a tuple are
    numbers of their own: a grid of end states is a set of candidates, whose order decides nothing but exact ties, so
    they need not stay sorted. Args: params, an instance of any params class, of numbers. Raises ConfigError for params
    that are traced or batched, and where they are none.
    """
    if not dataclasses.is_dataclass(params) or isinstance(params, type):
        raise ConfigError(f"params is {short(params)}: give an instance of a params class")
    if traced(params):
        raise ConfigError("params are traced: ask for their numbers outside jit")
    fixed = list(pinned(params).items())
    fixed += [(pattern, f"nothing reads it: {why}") for pattern, why in unread(params).items() if why]
    fixed = [(pattern, why) for pattern, why in fixed if why]
    return tuple(_trainable(leaf, fixed) for leaf in _leaves(params, ""))


def unit_of(comment: str) -> str:
    """The unit that a comment beside a field begins with: "m/s^2", "per rad of turn"; empty where it states none.

    Args: comment.
    """
    if comment.startswith("per "):
        return re.split(r"[,;:]", comment)[0]
    found = UNIT.match(comment)
    return found.group() if found else ""


class _Leaf(NamedTuple):
    """A float leaf, and the field that holds it."""

    key: str
    value: Any
    owner: type
    spec: dataclasses.Field


def _leaves(params: Any, prefix: str) -> Iterator[_Leaf]:
    for spec in stated(params):
        if spec.metadata.get("pytree_node", True):
            yield from _within(getattr(params, spec.name), f"{prefix}{spec.name}", type(params), spec)


def _within(value: Any, key: str, owner: type, spec: dataclasses.Field) -> Iterator[_Leaf]:
    if dataclasses.is_dataclass(value):
        yield from _leaves(value, f"{key}.")
    elif isinstance(value, tuple | list):
        for i, item in enumerate(value):
            yield from _within(item, f"{key}[{i}]", owner, spec)
    elif isinstance(value, float) or (hasattr(value, "dtype") and jnp.issubdtype(value.dtype, jnp.floating)):
        if np.ndim(value):
            raise ConfigError(
                f"'{key}' is an array of shape {np.shape(value)}: give params of numbers, one set of them"
            )
        yield _Leaf(key, value, owner, spec)


def _trainable(leaf: _Leaf, fixed: list[tuple[str, str]]) -> Trainable:
    value, (low, high) = number_of(leaf.value), bounds_of(leaf.spec)
    return Trainable(
        key=leaf.key,
        unit=unit_of(_comments(leaf.owner).get(leaf.spec.name, "")),
        value=value,
        low=low,
        high=high,
        transform=transform_of(value, low=low, high=high),
        scale=scale_of(value, low=low, high=high, size=_size(leaf.spec)),
        pinned=next((why for pattern, why in fixed if fits(leaf.key, pattern)), ""),
    )


def number_of(value: Any) -> float:
    """A value as whoever wrote it down would: of single precision 0.1, not 0.10000000149. Args: value, a float."""
    return float(str(np.asarray(value))) if hasattr(value, "dtype") else value


def _size(spec: dataclasses.Field) -> float:
    """How large a number of a field is by default; 1 where that is 0."""
    default = np.abs(np.asarray(default_of(spec) or 0.0, float))
    return float(default.mean()) or 1.0


@functools.cache
def _comments(owner: type) -> dict[str, str]:
    return comments_of(owner)
