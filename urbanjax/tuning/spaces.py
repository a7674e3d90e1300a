"""The space of what is tuned: a vector of free coordinates, from which params are made."""

import math
from collections.abc import Sequence
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from urbanjax.tuning.trainable import Trainable, number_of, trainables
from urbanjax.tuning.transforms import TRANSFORMS, Within
from urbanjax.types import ConfigError, host_record
from urbanjax.types.config import nearest
from urbanjax.types.pinned import fits

T = TypeVar("T")

ELEMENT = 0.2  # [-], what a unit of z adds to an element of a layer: a step that is small for a weight is so for it
LAYERS = tuple(f"stack.planning.micro.learned.{part}" for part in ("kernel", "bias"))


@host_record
class Space:
    """P numbers that are tuned. Holds no arrays, so that a function may close over it, or take it as a static one."""

    numbers: tuple[Trainable, ...]  # with a transform and bounds of their own, first of the coordinates
    rest: tuple[tuple[str, float], ...] = ()  # key and value of the elements beside them in tuples
    arrays: tuple[tuple[str, tuple[int, ...]], ...] = ()  # key and shape of free ones, as of a learned cost

    @property
    def keys(self) -> tuple[str, ...]:
        """Dotted keys [P] of the numbers, in the order of the coordinates, and of the elements of the arrays."""
        elements = [f"{key}{list(place)}" for key, shape in self.arrays for place in np.ndindex(*shape)]
        return (*(number.key for number in self.numbers), *elements)

    @property
    def size(self) -> int:
        """How many coordinates there are, P."""
        return len(self.numbers) + sum(math.prod(shape) for _, shape in self.arrays)

    def start(self) -> Array:
        """The coordinates [P] of the params that one starts from: zeros."""
        return jnp.zeros(self.size)

    def params(self, z: Array, base: T) -> T:
        """`base` with its tuned numbers moved; z = 0 is `base` itself, to the bit.

        Pure: jit it, vmap it over z, differentiate it with respect to z. Whatever z, values are finite and within their
        bounds; elements of arrays have none, and ELEMENT * z is added. Args: z [P], coordinates without a unit; base,
        params of the structure that the space was made of: z counts from their values. Raises ConfigError for z of
        another shape, and base without one of the numbers.
        """
        z = self._checked(z)
        paths, structure = jax.tree_util.tree_flatten_with_path(base)
        leaves = [leaf for _, leaf in paths]
        places = {jax.tree_util.keystr(path).removeprefix("."): i for i, (path, _) in enumerate(paths)}
        for key in (*(number.key for number in self.numbers), *(key for key, _ in self.arrays)):
            if key not in places:
                raise ConfigError(f"base is a {type(base).__name__} without '{key}': give what the space was made of")
        at = [places[number.key] for number in self.numbers]
        if at:
            moved = self._moved(z, jnp.stack([jnp.asarray(leaves[i], z.dtype) for i in at]))
            for i, value in zip(at, jnp.unstack(moved), strict=True):
                leaves[i] = value.astype(getattr(leaves[i], "dtype", z.dtype))
        begin = len(at)
        for key, shape in self.arrays:
            end = begin + math.prod(shape)
            leaves[places[key]] = leaves[places[key]] + ELEMENT * z[begin:end].reshape(shape)
            begin = end
        return jax.tree.unflatten(structure, leaves)

    def values(self, z: Array) -> dict[str, Any]:
        """What a parameter file says of these coordinates: numbers by dotted key, and the whole of each tuple.

        Nothing of the arrays, which do not stand in one. Args: z [P], concrete; 0 is what the space was made of. Raises
        ConfigError for another shape.
        """
        z = self._checked(z)
        if not self.numbers:
            return {}
        moved = self._moved(z, jnp.asarray([number.value for number in self.numbers], z.dtype))
        now = {number.key: number_of(value) for number, value in zip(self.numbers, np.asarray(moved), strict=True)}
        values: dict[str, Any] = {}
        for number in self.numbers:
            if number.key == number.field:
                values[number.key] = now[number.key]
            elif number.field not in values:
                elements = {**dict(self.rest), **now}
                beside = sum(key.startswith(f"{number.field}[") for key in elements)
                values[number.field] = [elements[f"{number.field}[{i}]"] for i in range(beside)]
        return values

    def _checked(self, z: Array) -> Array:
        z = jnp.asarray(z)
        if z.shape != (self.size,) or not jnp.issubdtype(z.dtype, jnp.floating):
            given = f"z is of {z.dtype} and shape {z.shape}"
            raise ConfigError(f"{given}: give a float for each of the {self.size} numbers")
        return z

    def _moved(self, z: Array, value: Array) -> Array:
        """The values of the numbers at z. Args: value, at z = 0."""
        kinds = np.array([number.transform for number in self.numbers])
        for kind in sorted(set(kinds)):
            at = np.flatnonzero(kinds == kind)
            limits = np.array([(number.low, number.high, number.scale) for number in self.numbers], z.dtype)[at]
            value = value.at[at].set(TRANSFORMS[kind](z[at], value[at], within=Within(*limits.T)))
        return value


def space(params: Any, patterns: Sequence[str], *, network: bool = False) -> Space:
    """The numbers of params that some patterns mean, of those that may be tuned.

    Args: params, of any class; patterns, dotted keys with `*` and `?`, or of groups and tuples; network, the layers of
    the learned cost of `params.stack` too. Raises ConfigError for a pattern that means no number (with the nearest that
    there is), or only fixed ones (with why), and a network that there is not.
    """
    patterns = [patterns] if isinstance(patterns, str) else list(patterns)
    arrays = layers(params) if network else ()
    if not patterns and not arrays:
        raise ConfigError("nothing is to be tuned: give at least one dotted key")
    numbers = trainables(params)
    wanted = {number.key for pattern in patterns for number in _tunable(pattern, numbers)}
    tuned = tuple(number for number in numbers if number.key in wanted)
    tuples = {number.field for number in tuned if number.key != number.field}
    return Space(tuned, tuple((n.key, n.value) for n in numbers if n.field in tuples and n.key not in wanted), arrays)


def layers(params: Any) -> tuple[tuple[str, tuple[int, ...]], ...]:
    """Key and shape of the layers of the learned cost of a loop.

    Args: params. Raises ConfigError where it has none.
    """
    paths = jax.tree_util.tree_flatten_with_path(params)[0]
    shapes = {jax.tree_util.keystr(path).removeprefix("."): jnp.shape(leaf) for path, leaf in paths}
    found = [(key, shape) for key, shape in shapes.items() if key.startswith(LAYERS)]
    if not found:
        raise ConfigError("there is no learned cost to tune: put `planning.learned.initial(...)` into the params")
    return tuple(found)


def meant_by(pattern: str, numbers: Sequence[Trainable]) -> list[Trainable]:
    """The numbers that a pattern means, fixed ones too. Raises ConfigError where there are none, with the nearest key.

    Args: pattern, see `space`; numbers, all that there are.
    """
    meant = [number for number in numbers if fits(number.key, pattern)]
    if not meant:
        keys = [key for number in numbers for key in (number.key, number.field)]
        raise ConfigError(f"'{pattern}' is no continuous number{nearest(pattern, keys)}")
    return meant


def _tunable(pattern: str, numbers: Sequence[Trainable]) -> list[Trainable]:
    """Those that a pattern means and that may be tuned. Raises ConfigError where there are none."""
    meant = meant_by(pattern, numbers)
    found = [number for number in meant if number.tunable]
    if not found:
        first = meant[0]
        named = len(meant) == 1 and pattern in (first.key, first.field)
        whom = f"'{pattern}' is fixed" if named else f"'{pattern}' means fixed numbers only, as '{first.key}'"
        raise ConfigError(f"{whom}: {first.pinned}")
    return found
