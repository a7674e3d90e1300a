"""Polynomials in closed form: quintics between two states, cubics between two slopes, and steps from 0 to 1."""

from typing import TypeVar

import jax.numpy as jnp
import numpy as np
from jax import Array

Values = TypeVar("Values", Array, np.ndarray)


def quintic(
    start: tuple[Array, Array, Array], end: tuple[Array, Array, Array], *, duration: Array
) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Coefficients a0..a5 of the quintic that meets both states (Eq. 17-18 with t_s = 0, solved by hand).

    The printed 6x6 inverse in absolute time is ill-conditioned; this form is exact in a few operations.
    Args: start, end: value, first and second derivative, elementwise of any equal shape; duration > 0.
    """
    x0, v0, a0 = start
    x1, v1, a1 = end
    t = duration
    d = x1 - x0 - v0 * t - 0.5 * a0 * t * t
    v = (v1 - v0 - a0 * t) * t
    a = (a1 - a0) * t * t
    return (
        x0,
        v0,
        0.5 * a0,
        (10 * d - 4 * v + 0.5 * a) / t**3,
        (-15 * d + 7 * v - a) / t**4,
        (6 * d - 3 * v + 0.5 * a) / t**5,
    )


def smoothstep(u: Values) -> Values:
    """The cubic that rises from 0 to 1 with u, flat at both ends. Args: u, 0 to 1, of JAX or NumPy."""
    return u * u * (3 - 2 * u)


def smoothstep_slope(u: Values) -> Values:
    """Derivative of `smoothstep`. Args: u, 0 to 1, of JAX or NumPy."""
    return 6 * u * (1 - u)


def hermite(u: Values) -> tuple[Values, Values, Values, Values]:
    """What start, end, start slope and end slope weigh in the cubic that meets them; slopes are per unit of u.

    Args: u, 0 to 1, of JAX or NumPy.
    """
    rest, end = 1 - u, smoothstep(u)
    reach = u * rest
    return 1 - end, end, reach * rest, -reach * u


def hermite_slope(u: Values) -> tuple[Values, Values, Values, Values]:
    """Derivatives of `hermite`. Args: u, 0 to 1, of JAX or NumPy."""
    end = smoothstep_slope(u)
    return -end, end, (1 - u) * (1 - 3 * u), u * (3 * u - 2)


def smoother_step(u: Array) -> Array:
    """The quintic that rises from 0 to 1 with u, flat and straight at both ends. Args: u, 0 to 1."""
    return u * u * u * (10 - 15 * u + 6 * u * u)


def evaluate(coefficients: tuple[Array, ...], t: Array) -> tuple[Array, Array, Array]:
    """Value, first and second derivative of a polynomial at t, elementwise (Eq. 16, by Horner's rule).

    Args: coefficients, from the constant upwards; t, of their shape.
    """
    value = first = second = jnp.zeros_like(t)
    for c in reversed(coefficients):
        second = second * t + 2 * first
        first = first * t + value
        value = value * t + c
    return value, first, second
