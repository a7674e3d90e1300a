"""Hard choices and their soft twins, told apart by one `Relaxation`.

A choice is returned as *weights* or as a *degree* in [0, 1], and its consequences are weighted sums. In mode
`hard` the weights are one-hot and the degree is 0 or 1, so one code path serves all modes:

- `hard`: the deployed decision; piecewise constant, gradient zero through the choice.
- `soft`: smooth in everything, so finite differences agree with its gradient; temperature -> 0 gives `hard`
  away from ties. Meant for candidates of one homotopy class (the average of left and right is a crash).
- `straight_through`: value of `hard`, derivative of `soft`; biased, but what deployment-like tuning wants.
"""

from collections.abc import Callable
from typing import ClassVar, TypeVar

import jax
import jax.numpy as jnp
from jax import Array
from jax.flatten_util import ravel_pytree
from jaxtyping import Bool, Float

from urbanjax.numerics import lean, safe
from urbanjax.types import POSITIVE, SOFT, ConfigError, field, pytree, static

T = TypeVar("T")

MODES = ("hard", "soft", "straight_through")


@pytree
class Relaxation:
    """How hard choices are relaxed, and how much."""

    PINNED: ClassVar[dict[str, str]] = {"temperature": SOFT}

    temperature: float = field(default=0.1, metadata=POSITIVE)  # [-], multiplied by the natural scale of each choice
    mode: str = static(default="hard", metadata={"choices": MODES})


def combine(hard: Callable[[], Array], soft: Callable[[], Array], *, relaxation: Relaxation) -> Array:
    """What the mode makes of a decision and its smooth twin, of equal shapes; `hard` passes no gradient.

    Both are functions without arguments, so that a mode computes only what it needs.
    Args: hard and soft; relaxation, its mode.
    """
    if relaxation.mode == "hard":
        return jax.lax.stop_gradient(hard())
    if relaxation.mode == "soft":
        return soft()
    if relaxation.mode == "straight_through":
        smooth = soft()
        return jax.lax.stop_gradient(hard()) + (smooth - jax.lax.stop_gradient(smooth))
    raise ConfigError(f"relaxation.mode is {relaxation.mode!r}: use one of {', '.join(MODES)}")


def _masked(values: Array, mask: Array | None, fill: float) -> Array:
    return values if mask is None else lean.where(jnp.broadcast_to(mask, values.shape), values, fill)


def choose(
    cost: Float[Array, "*b n"],
    relaxation: Relaxation,
    *,
    scale: float | Float[Array, ""] = 1.0,
    mask: Bool[Array, "*b n"] | None = None,
) -> Float[Array, "*b n"]:
    """Weights over the last axis, summing to 1, on the smallest cost (the first one on an exact tie).

    Args: cost [.., n]; relaxation, hard or how soft; scale, the difference in cost that counts as clear; mask [.., n],
    what may be chosen. With nothing allowed the weights fall on index 0 (hard) or are uniform (soft): the caller looks
    at the mask.
    """
    big = float(jnp.finfo(cost.dtype).max) / 4  # sums and differences of it stay finite

    def first() -> Array:
        return jax.nn.one_hot(lean.argmin(_masked(cost, mask, big)), cost.shape[-1], dtype=cost.dtype)

    def smooth() -> Array:
        # Masked after the division, which would overflow and leave no finite derivative by the temperature.
        return jax.nn.softmax(_masked(-cost / (relaxation.temperature * scale), mask, -big), axis=-1)

    return combine(first, smooth, relaxation=relaxation)


def above(
    x: Float[Array, "*s"], threshold: float | Array, relaxation: Relaxation, *, scale: float | Array = 1.0
) -> Float[Array, "*s"]:
    """Degree in [0, 1] to which x > threshold.

    Args: x [*s]; threshold, in the unit of x; relaxation, hard or how soft; scale, the margin that counts as clear, in
    the unit of x.
    """
    return combine(
        lambda: (x > threshold).astype(x.dtype),
        lambda: jax.nn.sigmoid((x - threshold) / (relaxation.temperature * scale)),
        relaxation=relaxation,
    )


def minimum(
    values: Float[Array, "*b n"],
    relaxation: Relaxation,
    *,
    scale: float | Array = 1.0,
    mask: Bool[Array, "*b n"] | None = None,
    fill: float = 1e6,
) -> Float[Array, "*b"]:
    """The minimum over the last axis, or -T log sum exp(-values / T), a lower bound within T log n.

    `fill` stands in for masked entries, and is the value when all are masked.
    Args: values [.., n]; relaxation, hard or how soft; scale, the difference that counts as clear; mask [.., n],
    entries that count; fill, in the unit of the values.
    """
    masked = _masked(values, mask, fill)
    if relaxation.mode == "hard":
        return safe.minimum(masked)

    def smooth() -> Array:
        t = relaxation.temperature * scale
        least = jax.lax.stop_gradient(jnp.min(masked, axis=-1))
        return least - t * jnp.log(jnp.sum(jnp.exp((least[..., None] - masked) / t), axis=-1))

    return combine(lambda: safe.minimum(masked), smooth, relaxation=relaxation)


def mixed(weights: Float[Array, "n"], values: T) -> T:
    """Every leaf weighted over its first axis, all of them in one product.

    Taken relative to the first of the values: large coordinates lose no precision.
    Args: weights [n], summing to 1; values, any pytree with first axis n.
    """
    first, apart = ravel_pytree(jax.tree.map(lambda x: x[0], values))
    each = jax.vmap(lambda one: ravel_pytree(one)[0])(values)
    others = jnp.tensordot(weights, each - first[None, :], axes=1, precision=jax.lax.Precision.HIGHEST)
    return apart(first + others)


def both(a: Array, b: Array) -> Array:
    """Degree of (a and b). Args: a, b, degrees."""
    return a * b


def either(a: Array, b: Array) -> Array:
    """Degree of (a or b). Args: a, b, degrees."""
    return a + b - a * b


def negate(a: Array) -> Array:
    """Degree of (not a). Args: a, a degree."""
    return 1 - a
