"""From the losses of many scenes to one: their mean, or that of the worst."""

import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import Float


def tail_weights(losses: Float[Array, "*b n"], share: float | Array) -> Float[Array, "*b n"]:
    """Weights [.., N], summing to 1, with which the losses give their conditional value at risk.

    CVaR (Rockafellar and Uryasev 2000): the mean of the worst share, of which the last one may count in part; a share
    of 1 is the mean of all. Held while differentiating, they give its gradient, as it is piecewise linear. Args: losses
    [.., N], finite; share in (0, 1].
    """
    count = losses.shape[-1]
    order = jnp.argsort(-losses, axis=-1)
    wanted = jnp.clip(jnp.asarray(share, losses.dtype) * count - jnp.arange(count, dtype=losses.dtype), 0.0, 1.0)
    worst_first = wanted / jnp.sum(wanted)
    rank = jnp.argsort(order, axis=-1)
    return lax.stop_gradient(jnp.take(worst_first, rank))


def cvar(losses: Float[Array, "*b n"], share: float | Array) -> Float[Array, "*b"]:
    """The mean of the worst share of the losses, see `tail_weights`. Args: losses [.., N]; share in (0, 1]."""
    return jnp.sum(tail_weights(losses, share) * losses, axis=-1)
