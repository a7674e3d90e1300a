"""Block bootstrap of a series: neighbouring samples depend on each other, so whole blocks of them are drawn."""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Int

from urbanjax.types.errors import TrafficError


def blocks(key: Array, n: int, *, block: int, draws: int) -> Int[Array, "{draws} {n}"]:
    """Indices of resampled series [draws, n]: blocks of consecutive samples, on from the last to the first.

    Wrapped so, every sample is as likely as any other (Politis & Romano 1992). Blocks that stop at the ends take the
    first and last samples less often: on a log that begins at standstill, that moves the draws to one side.
    Args: key, of jax.random; n, samples of the series; block, samples that stay together; draws, number of series.
    Raises TrafficError if the series has no such block.
    """
    if not 1 <= block <= n:
        raise TrafficError(f"bootstrap: blocks of {block} samples of a series of {n}; give from 1 to {n}")
    count = -(-n // block)
    first = jax.random.randint(key, (draws, count, 1), 0, n)
    return ((first + jnp.arange(block)[None, None]) % n).reshape(draws, -1)[:, :n]
