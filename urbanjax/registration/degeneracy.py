"""Which directions a registration says nothing about: corridors, planes, open fields."""

import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import Float

from urbanjax.types import SHARE, field, pytree

RIDGE = 1e-6  # share of its trace that is added to a block's diagonal before it is inverted
LEAST_INFORMATION = 1e-6  # trace, below which it counts as this one: without points nothing divides by 0


@pytree
class DegeneracyParams:
    """When a direction counts as unobserved."""

    # of the information on all three directions, below which one is degenerate
    share: float = field(default=0.01, metadata=SHARE)


@pytree
class Directions:
    """Three orthogonal directions of the body frame, from the least to the best observed."""

    axes: Array  # [3, 3] unit vectors, one per row
    share: Array  # [3] of the information; they sum to 1
    degenerate: Array  # [3] bool


@pytree
class Degeneracy:
    """Translation and rotation apart, each with the other one free."""

    translation: Directions
    rotation: Directions


def degeneracy(hessian: Float[Array, "6 6"], params: DegeneracyParams | None = None) -> Degeneracy:
    """How much is known about each direction, without unit or scale.

    The information on translation with the rotation unknown is the Schur complement H_vv - H_vr H_rr^-1 H_rv, and the
    other way round; a direction is judged by its share of it, so that neither the number of points, the noise nor the
    mix of radians and metres matters. Args: hessian [6, 6] of an `Alignment`, twists [omega; v] in rad and m.
    """
    params = DegeneracyParams() if params is None else params
    rotation, mixed, translation = hessian[:3, :3], hessian[:3, 3:], hessian[3:, 3:]
    return Degeneracy(
        translation=_directions(_known(translation, mixed.T, rotation), params),
        rotation=_directions(_known(rotation, mixed, translation), params),
    )


def _known(own: Array, mixed: Array, other: Array) -> Array:
    """The Schur complement, own - mixed other^-1 mixed', finite where `other` says nothing at all."""
    least = RIDGE * jnp.maximum(jnp.trace(other), LEAST_INFORMATION)
    explained = jnp.linalg.solve(other + least * jnp.eye(3, dtype=other.dtype), mixed.T)
    return own - jnp.matmul(mixed, explained, precision=lax.Precision.HIGHEST)


def _directions(information: Array, params: DegeneracyParams) -> Directions:
    values, vectors = jnp.linalg.eigh((information + information.T) / 2)
    values = jnp.maximum(values, 0)
    total = jnp.sum(values)
    share = jnp.where(total > 0, values / jnp.where(total > 0, total, 1), 0)
    return Directions(axes=vectors.T, share=share, degenerate=share < params.share)
