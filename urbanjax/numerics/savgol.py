"""Savitzky-Golay filters as `scipy.signal.savgol_filter` has them, also for sequences that end where a number says.

Ends are as in its mode "interp": the polynomial of the outermost window, evaluated at each of the outermost points.
Windows of even length lie half a step aside of their point, as there.
"""

import functools

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, Int
from scipy.signal import savgol_filter


def savgol(
    values: Float[Array, " t"],
    n: Int[Array, ""],
    *,
    window: int,
    order: int,
    derivative: int = 0,
    spacing: float | Array = 1.0,
) -> Float[Array, " t"]:
    """The first n of the values filtered; what follows them means nothing.

    Fewer values than the window holds are filled up with those that follow. A window longer than all values is cut to
    them, and the order to what it then allows.
    Args: values [T]; n, how many count; window, its length, odd or even; order, of the polynomial; derivative, which
    one (0: the smoothed values); spacing, of the values.
    """
    length = values.shape[0]
    window = min(window, length)
    table = jnp.asarray(_table(window, min(order, window - 1), derivative), values.dtype)
    half, lead = window // 2, (window - 1) // 2
    n = jnp.clip(n, window, length)
    at = jnp.arange(length)
    late = at - (n - half)
    row = jnp.where(late >= 0, jnp.minimum(half + 1 + late, 2 * half), jnp.minimum(at, half))
    start = jnp.clip(at - lead, 0, n - window)
    gathered = values[start[:, None] + jnp.arange(window)[None]]
    return jnp.sum(table[row] * gathered, axis=-1) / spacing**derivative


@functools.cache
def savgol_matrix(n: int, window: int, *, order: int, derivative: int = 0) -> Float[np.ndarray, "n n"]:
    """The filter as a matrix [n, n] on n values, for sequences of a length that is known (host side).

    A window longer than all values is cut to them, and the order to what it then allows. Args: n, number of values;
    window, its length; order, of the polynomial; derivative, which one by step (0: the smoothed values).
    """
    size = min(window, n)
    return np.asarray(savgol_filter(np.eye(n), size, min(order, size - 1), deriv=derivative, axis=0))


@functools.cache
def _table(window: int, order: int, derivative: int) -> np.ndarray:
    """Coefficients [2 (window // 2) + 1, window]: at the points of the left end, inside, at those of the right end."""
    many, half, lead = 2 * window + 1, window // 2, (window - 1) // 2
    probe = savgol_matrix(many, window, order=order, derivative=derivative)
    inside = probe[window, window - lead : 2 * window - lead]
    return np.concatenate([probe[:half, :window], inside[None], probe[many - half :, many - window :]])
