"""String stability in the frequency domain: how each vehicle passes on the speed of the one ahead, by Welch's method.

A gain above 1 at some frequency says that speed changes at that frequency grow. Batches go through vmap.
"""

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float

from urbanjax.numerics import masked, safe
from urbanjax.traffic.flow.stability import ahead
from urbanjax.types import pytree
from urbanjax.types.errors import TrafficError


@pytree
class Transfer:
    """Spectra of V vehicles at F frequencies, over the segments that a vehicle and the one ahead both have whole."""

    frequency: Array  # [F] Hz, from 0 to half the sampling rate
    power: Array  # [V, F] (m/s)^2 / Hz, of the vehicle's speed, over its own whole segments
    gain: Array  # [V, F] |H|, from the speed of the vehicle ahead
    phase: Array  # [V, F] rad in (-pi, pi], negative where the vehicle is late
    coherence: Array  # [V, F] in [0, 1]; of one segment alone it is 1 and says nothing
    segments: Array  # [V] int32, that were averaged; 0 without a vehicle ahead


def transfer(
    speed: Float[Array, "v t"], mask: Bool[Array, "v t"], *, rate: float | Float[Array, ""], length: int
) -> Transfer:
    """Transfer from each vehicle's predecessor to it: segments with a Hann window that overlap by half, mean removed.

        H = S_xy / S_xx,    coherence = |S_xy|^2 / (S_xx S_yy)    (x ahead, y behind)

    As scipy.signal.welch and csd, where all samples count. Noise of the vehicle behind averages out of S_xy; noise of
    the one ahead lowers the gain. Differentiable.
    Args: speed [V, T] m/s; mask [V, T], samples that count; rate, samples per second; length, samples of a segment.
    Raises TrafficError if the series has no such segment.
    """
    if not 2 <= length <= speed.shape[1]:
        raise TrafficError(f"segments of {length} samples of a series of {speed.shape[1]}; give from 2 to that")
    starts = np.arange(0, speed.shape[1] - length + 1, length // 2)
    at = starts[:, None] + np.arange(length)[None]
    whole = jnp.all(mask[:, at], axis=-1)
    pieces = jnp.where(whole[..., None], speed[:, at], 0)
    pieces = pieces - jnp.mean(pieces, axis=-1, keepdims=True)
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(length) / length)
    spectra = jnp.fft.rfft(pieces * jnp.asarray(window, speed.dtype)[None, None], axis=-1)

    row, pair = ahead(jnp.any(mask, axis=1))
    both = (whole & whole[row] & pair[:, None])[..., None]
    here, there = jnp.moveaxis(spectra, 1, -1), jnp.moveaxis(spectra[row], 1, -1)
    both = jnp.broadcast_to(jnp.moveaxis(both, 1, -1), here.shape)
    cross = jnp.conj(there) * here
    real, imaginary = masked.mean(cross.real, both), masked.mean(cross.imag, both)
    front, rear = masked.mean(_square(there), both), masked.mean(_square(here), both)
    size = safe.sqrt(real**2 + imaginary**2)

    sides = np.full(length // 2 + 1, 2.0)
    sides[0] = 1
    sides[-1] = 1 if length % 2 == 0 else 2
    density = jnp.asarray(sides / np.sum(window**2), speed.dtype) / rate
    own = jnp.broadcast_to(whole[:, None], here.shape)
    return Transfer(
        frequency=jnp.arange(length // 2 + 1, dtype=speed.dtype) * rate / length,
        power=masked.mean(_square(here), own) * density[None],
        gain=safe.divide(size, front),
        phase=safe.arctan2(imaginary, real),
        coherence=safe.divide(size**2, front * rear),
        segments=jnp.sum(both[:, 0], axis=-1, dtype=jnp.int32),
    )


def worst(
    found: Transfer,
    low: float | Float[Array, ""],
    *,
    high: float | Float[Array, ""],
    coherence: float | Float[Array, ""] = 0.5,
) -> tuple[Float[Array, " v"], Float[Array, " v"], Bool[Array, " v"]]:
    """Greatest gain of each vehicle in a band, its frequency [Hz], and whether any frequency qualifies.

    None does for a vehicle with one segment only, whose coherence says nothing.
    Args: found, the spectra; low, high, the band [Hz]; coherence, least one at which a gain is taken to be of the
    vehicle ahead.
    """
    band = (found.frequency >= low) & (found.frequency <= high)
    counts = (found.coherence >= coherence) & band[None] & (found.segments > 1)[:, None]
    at = jnp.argmax(jnp.where(counts, found.gain, -jnp.inf), axis=-1)
    some = jnp.any(counts, axis=-1)
    gain = jnp.take_along_axis(found.gain, at[:, None], axis=-1)[:, 0]
    return jnp.where(some, gain, 0), jnp.where(some, found.frequency[at], 0), some


def _square(x: Array) -> Array:
    return x.real**2 + x.imag**2
