"""Samples that coincide, for which the logarithm of a distance does not exist: one of four stated policies."""

import jax
import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import Bool, Float

POLICIES = ("error", "dedupe", "jitter", "floor")


def duplicates(points: Float[Array, "n d"], valid: Bool[Array, " n"]) -> Bool[Array, " n"]:
    """Samples that repeat a valid one which comes earlier in order of coordinates; one of each is kept.

    Args: points [N, D], in any units; valid [N], samples that count.
    """
    last = ~valid  # sorted behind the valid ones
    axes = tuple(points[:, i] for i in range(points.shape[1]))
    index = jnp.arange(points.shape[0], dtype=jnp.int32)
    *keys, order = lax.sort((last, *axes, index), num_keys=1 + len(axes))
    same = jnp.ones(points.shape[0], bool)
    for key in keys:
        same = same & (key == jnp.roll(key, 1))
    same = same & ~keys[0] & (index > 0)
    return jnp.zeros_like(valid).at[order].set(same)


def finite(
    points: Float[Array, "t n d"], valid: Bool[Array, "t n"]
) -> tuple[Float[Array, "t n d"], Bool[Array, "t n"], Bool[Array, " t"]]:
    """The samples with 0 for those that are not finite, the mask without these, and the teams that had none of them.

    Args: points [T, N, D], in any units; valid [T, N], samples that count.
    """
    good = jnp.all(jnp.isfinite(points), axis=-1)
    return jnp.where(good[..., None], points, 0), valid & good, jnp.all(good | ~valid, axis=-1)


def separated(
    points: Float[Array, "t n d"], valid: Bool[Array, "t n"], *, policy: str, size: Array, key: Array | None
) -> tuple[Float[Array, "t n d"], Bool[Array, "t n"]]:
    """Samples and mask after the policies that change samples: `dedupe` and `jitter`.

    Args: points [T, N, D] m; valid [T, N], samples that count; policy, one of POLICIES; size [m], half width of the
    uniform noise; key, of jax.random, for the noise (needed by `jitter`).
    """
    if policy == "dedupe":
        return points, valid & ~jax.vmap(duplicates)(points, valid)
    if policy == "jitter":
        if key is None:
            raise ValueError("the policy 'jitter' needs a random key")
        return points + size * jax.random.uniform(key, points.shape, points.dtype, -1, 1), valid
    return points, valid


def counted(
    own: Float[Array, "*b n"], other: Float[Array, "*b n"], *, used: Bool[Array, "*b n"], policy: str, size: Array
) -> tuple[Array, Array, Bool[Array, "*b n"]]:
    """Distances to own and other neighbours that have a logarithm, and the samples that count.

    `floor` raises distances to `size` [m]; the others leave out samples with a distance of 0 (`error` reports them).
    Args: own, other [..., N] m, distances to the neighbours; used [..., N], samples that count so far; policy, one of
    POLICIES; size [m].
    """
    if policy == "floor":
        return jnp.maximum(own, size), jnp.maximum(other, size), used
    apart = used & (own > 0) & (other > 0)
    return jnp.where(apart, own, 1), jnp.where(apart, other, 1), apart
