"""A cost that is learned, added beside the linear one: a small network of candidate and scene.

It is 0 until it is trained, and so small against the price of a broken limit that it cannot make a candidate that
breaks one cheaper than it makes one that does not.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from urbanjax.numerics import lean, safe
from urbanjax.planning.primitives import Fan
from urbanjax.types import pytree

CONTEXT = ("speed", "limit", "curvature", "free_speed", "gap", "room")  # of the scene
BOUND = 100.0  # m, of cost: twice this is a fifth of what a broken limit costs
SIZES = np.array([20.0, 20.0, 0.02, 20.0, 30.0, 5.0])  # m/s, m/s, 1/m, m/s, m, m: what is much of CONTEXT


@pytree
class LearnedCost:
    """Two hidden layers of tanh; the last layer begins as 0."""

    kernel: tuple[Array, ...]  # of each layer, [in, out]
    bias: tuple[Array, ...]  # of each layer, [out]
    size: Array  # [C] what is much of each cost term at weight 1

    def __call__(self, features: Float[Array, "j c"], context: Float[Array, "x"]) -> Float[Array, "j"]:
        """Cost [J] (m) within plus and minus BOUND.

        Args: features [J, C], cost terms at weights of 1; context [X], of the scene.
        """
        above = features - safe.minimum(features, 0)[None, :]
        about = jnp.broadcast_to(context / SIZES, (features.shape[0], context.shape[0]))
        values = jnp.concatenate([jnp.tanh(above / self.size[None, :]), jnp.tanh(about)], axis=1)
        for kernel, bias in zip(self.kernel[:-1], self.bias[:-1], strict=True):
            values = jnp.tanh(values @ kernel + bias[None, :])
        raw = (values @ self.kernel[-1] + self.bias[-1][None, :])[:, 0]
        return BOUND * jnp.tanh(raw / BOUND)


def initial(key: Array, size: Float[Array, "c"], *, hidden: int = 16) -> LearnedCost:
    """A network that adds nothing yet.

    Args: key, of its first layers; size [C], what is much of each cost term at weight 1; hidden, units of a layer.
    """
    widths = (size.shape[0] + len(CONTEXT), hidden, hidden, 1)
    keys = jax.random.split(key, 2)
    kernels = [jax.random.normal(k, (a, b)) / np.sqrt(a) for k, a, b in zip(keys, widths[:2], widths[1:3], strict=True)]
    return LearnedCost(
        kernel=(*kernels, jnp.zeros((widths[2], 1))),
        bias=tuple(jnp.zeros(n) for n in widths[1:]),
        size=jnp.maximum(size, 1e-3),
    )


def context_of(fan: Fan, *, room: Float[Array, "j k"]) -> Float[Array, "x"]:
    """What the network is told of the scene [X], by CONTEXT.

    The gap is how far the candidate that keeps most to the macro plan gets before it touches somebody. Args: fan, of
    candidates; room [J, K] m, clearance at each point.
    """
    middle = jnp.argmin(jnp.abs(fan.end.beside) - 1e-3 * fan.end.speed)
    ahead = fan.station - fan.station[0]
    touches = room[middle] < 0
    gap = jnp.where(jnp.any(touches), ahead[jnp.argmax(touches)], ahead[-1])
    return jnp.stack(
        [
            fan.speed[0, 0],
            fan.road.limit[0],
            safe.maximum(jnp.abs(fan.road.curvature)),
            fan.free_speed[-1],
            gap,
            lean.minimum(safe.minimum(room[middle]), 10.0),
        ]
    )
