"""From a free coordinate z to a value within its bounds; z = 0 is the value that one starts from, to the bit.

Each maps any finite z to a finite value with a finite derivative. One unit of z is a change by about the scale of the
number (`scale_of`), so that one step size suits all of them: weights of 0.05 and of 200, shares and offsets.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

REACH = 30.0  # of z in an exponent, beyond which a value stays as it is: a factor of 1e13


class Within(NamedTuple):
    """What P numbers keep to."""

    low: np.ndarray  # [P] in the unit of each
    high: np.ndarray  # [P]
    scale: np.ndarray  # [P]


def transform_of(value: float, *, low: float, high: float) -> str:
    """The transform that suits a number: the key of TRANSFORMS.

    Between two bounds it is "logit", above one "log", without any "identity". A number that stands on its bound, where
    both have lost it (there is no logarithm of 0), is folded back from there: "fold". Args: value; low and high, its
    bounds, in its unit, infinite for none.
    """
    if math.isinf(low) and math.isinf(high):
        return "identity"
    if not low < value < high or math.isinf(low):
        return "fold"
    return "log" if math.isinf(high) else "logit"


def scale_of(value: float, *, low: float, high: float, size: float) -> float:
    """By how much a unit of z changes the value, at z = 0 and to first order.

    Args: value; low and high, its bounds, in its unit; size of such numbers, for those that have none of their own.
    """
    kind = transform_of(value, low=low, high=high)
    if kind == "log":
        return value - low
    if kind == "logit":
        return (value - low) * (high - value) / (high - low)
    return min(size, (high - low) / 4)  # as steep as a logit can be


def identity(z: Float[Array, "p"], value: Float[Array, "p"], *, within: Within) -> Float[Array, "p"]:
    """The value and so many scales. Args: z [P]; value [P], at z = 0; within, bounds and scales."""
    return value + within.scale * z


def log(z: Float[Array, "p"], value: Float[Array, "p"], *, within: Within) -> Float[Array, "p"]:
    """The value with its distance from the lower bound times e^z. Args: z [P]; value [P], at z = 0; within, bounds."""
    z = jnp.clip(z, -REACH, REACH)
    return jnp.maximum(value * jnp.exp(z) - within.low * jnp.expm1(z), within.low)


def logit(z: Float[Array, "p"], value: Float[Array, "p"], *, within: Within) -> Float[Array, "p"]:
    """The value with the odds of its share of the range times e^z.

    Args: z [P]; value [P], at z = 0; within, bounds.
    """
    z = jnp.clip(z, -REACH, REACH)
    below, above = value - within.low, within.high - value
    change = below * above * jnp.expm1(z) / (above + below * jnp.exp(z))
    return jnp.clip(value + change, within.low, within.high)


def fold(z: Float[Array, "p"], value: Float[Array, "p"], *, within: Within) -> Float[Array, "p"]:
    """The value and so many scales, mirrored at the bounds: steep everywhere, so that no step gets stuck at one.

    On a bound the derivative is that of going up. Args: z [P]; value [P], at z = 0; within, bounds and scales.
    """
    low, high = (np.where(np.isfinite(x), x, 0) for x in (within.low, within.high))
    both = np.isfinite(within.low) & np.isfinite(within.high)
    span = np.where(both, high - low, 1)
    x = value + within.scale * z
    along = jnp.mod(x - low, 2 * span)
    there_and_back = low + jnp.where(along <= span, along, 2 * span - along)
    mirrored = jnp.where(x < within.low, 2 * low - x, 2 * high - x)
    outside = jnp.where(both, there_and_back, mirrored)
    inside = (x >= within.low) & (x <= within.high)
    return jnp.where(inside, x, jnp.clip(outside, within.low, within.high))


TRANSFORMS: dict[str, Callable[..., Array]] = {"identity": identity, "log": log, "logit": logit, "fold": fold}
