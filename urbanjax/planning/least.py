"""The smallest clearance at each point of a passage, of the boxes that are there: the value alone, and fast.

Of the boxes that a prediction has places for few are there, and nobody else need be looked at. Points come last in all
arrays, boxes before them: the compiler makes vectors of the last axis.
"""

import jax
import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import Float

from urbanjax.geometry.boxes import Box
from urbanjax.numerics import lean
from urbanjax.numerics.in_turn import in_turn
from urbanjax.planning.clearance import Others, Passage, ego_at, gaps_between, unit_vector
from urbanjax.planning.prediction import time_weights
from urbanjax.types import Prediction
from urbanjax.vehicle.driving import Driving

GROUP = 4  # boxes looked at together


def least_gap(passage: Passage, driving: Driving, *, prediction: Prediction, ignored: Float[Array, "b"]) -> Array:
    """Smallest gap [n] (m) at each point to any predicted box, as `clearance.gaps` has it in mode hard.

    Without a derivative. Args: passage [n], of the ego; driving, with ClearanceParams; prediction, of everybody else;
    ignored [B], degree to which an object does not count.
    """
    return _least_gap(passage, driving, prediction, ignored)


@in_turn
def _least_gap(passage: Passage, driving: Driving, prediction: Prediction, ignored: Array) -> Array:
    ego = jax.tree.map(jnp.transpose, ego_at(passage, driving))  # [1, n]
    weights = time_weights(prediction, passage.time)
    local, heading = prediction.position - passage.position[0][None, None, :], prediction.heading
    poses = jnp.stack([*jnp.unstack(local, axis=-1), jnp.cos(heading), jnp.sin(heading)], axis=1)
    sizes = prediction.length / 2, prediction.width / 2
    each = jnp.stack([*sizes, prediction.speed, prediction.valid.astype(ignored.dtype), ignored], axis=-1)
    there_first = jnp.argsort(~prediction.valid, stable=True)
    count, group = jnp.sum(prediction.valid), min(GROUP, ignored.shape[0])

    def nearer(found: tuple[Array, Array]) -> tuple[Array, Array]:
        first, least = found
        which = lax.dynamic_slice_in_dim(there_first, first, group)
        x, y, cos, sin = jnp.unstack(_at_times(lean.rows(poses, which), weights), axis=1)
        half_length, half_width, speed, valid, unseen = jnp.unstack(lean.rows(each, which)[..., None], axis=1)
        others = Others(Box(x, y, *unit_vector(cos, sin), half_length, half_width), speed, valid > 0, unseen)
        return first + group, lean.minimum(least, jnp.min(gaps_between(ego, others, mode="hard"), axis=0))

    free = jnp.broadcast_to(ego.far, passage.time.shape)
    return lax.while_loop(lambda found: found[0] < count, nearer, (jnp.zeros_like(count), free))[1]


def _at_times(poses: Float[Array, "c 4 h"], weights: Float[Array, "n h"]) -> Float[Array, "c 4 n"]:
    """Poses at other times, see `basis.product`; points last."""
    return lax.dot_general(poses, weights, (((2,), (1,)), ((), ())), precision=lax.Precision.HIGHEST)
