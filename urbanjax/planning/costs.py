"""Cost terms of planning, one short function each; weights stay outside (Eq. 13, 14, 22, 23).

Integrals along a path come by segment, so that all of them are summed at once.
"""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.numerics import lean, safe

BARRIERS = ("hinge", "gaussian")
MIN_STEP = 1e-3  # m between two points, at the least, since rates are divided by it
CURVATURE_ROUNDING = 1e-4  # 1/m, a bend of 10 km radius, over which the tip of |kappa| is rounded


def barrier(clearance: Float[Array, "*s"], threshold: float | Array, *, kind: str = "hinge") -> Float[Array, "*s"]:
    """Cost of being near: (c0 - c)^2 (m^2) below the threshold c0, or as `gaussian` exp(-(c / c0)^2 / 2) (no unit).

    The printed + k ||O - N|| rewards nearness to obstacles; this one falls with clearance. Args: clearance, signed m;
    threshold c0, m; kind, one of BARRIERS.
    """
    if kind == "gaussian":
        return jnp.exp(-((lean.maximum(clearance, 0) / threshold) ** 2) / 2)
    missing = lean.maximum(threshold - clearance, 0)
    return missing * missing


def smooth_abs(x: Float[Array, "*s"], rounding: float = 1e-3) -> Float[Array, "*s"]:
    """|x| with a rounded tip: 0 at 0 and differentiable there. Args: x; rounding, how far it is below |x| at most."""
    return jnp.sqrt(x * x + rounding * rounding) - rounding


def smaller(a: Float[Array, "*s"], b: Float[Array, "*s"]) -> Float[Array, "*s"]:
    """The smaller of two, with a rounded tip where they are equal. Args: a, b, of one shape."""
    return (a + b - smooth_abs(a - b)) / 2


def parts(values: Float[Array, "*s k"], step: Float[Array, "*s e"]) -> Float[Array, "*s e"]:
    """What each segment adds to the trapezoidal integral.

    Args: values [.., K] at points; step [.., K-1] between them.
    """
    return (values[..., 1:] + values[..., :-1]) / 2 * step


def segments(position: Float[Array, "*s k 2"]) -> Float[Array, "*s e"]:
    """Distance [.., K-1] (m) between consecutive points; their sum is the travelled distance f of Eq. 24.

    Args: position [.., K, 2] m.
    """
    return safe.norm(position[..., 1:, :] - position[..., :-1, :])


def curvature(kappa: Float[Array, "*s k"], step: Float[Array, "*s e"]) -> Float[Array, "*s e"]:
    """Integral of |kappa| ds (rad), the second term of Eq. 22, by segment.

    Args: kappa [.., K] 1/m; step [.., K-1] m.
    """
    return parts(smooth_abs(kappa, CURVATURE_ROUNDING), step)


def curvature_rate(kappa: Float[Array, "*s k"], step: Float[Array, "*s e"]) -> Float[Array, "*s e"]:
    """Integral of (d kappa / ds)^2 ds (1/m^3), by segment. Args: kappa [.., K] 1/m; step [.., K-1] m."""
    change = kappa[..., 1:] - kappa[..., :-1]
    return safe.divide(change * change, step)


def deviation(
    offset: Float[Array, "*s k"],
    other: Float[Array, "*#s k"],
    *,
    counts: Float[Array, "*#s k"],
    step: Float[Array, "*s e"],
) -> Float[Array, "*s e"]:
    """Integral of |offset - other| ds (m^2) at equal station, where it counts (Eq. 23), by segment.

    The printed index-wise distance punishes driving on. Args: offset [.., K] m, of the plan; other [.., K] m, the
    offset that it is compared with; counts [.., K], degree to which that counts; step [.., K-1] m.
    """
    return parts(smooth_abs(offset - other) * counts, step)


def slowness(
    speed: Float[Array, "*s k"], desired: Float[Array, "*#s k"], *, time: Float[Array, "*s k"]
) -> Float[Array, "*s e"]:
    """Integral of (v_des - v)^2 dt (m^2/s), by segment: Eq. 24's length alone would reward not to drive.

    Args: speed and desired, [.., K] m/s; time [.., K] s, of passing each point.
    """
    return parts((desired - speed) ** 2, jnp.diff(time, axis=-1))


def lateral_acceleration(
    speed: Float[Array, "*s k"], kappa: Float[Array, "*s k"], *, time: Float[Array, "*s k"]
) -> Float[Array, "*s e"]:
    """Integral of (v^2 kappa)^2 dt (m^2/s^3), by segment.

    Args: speed [.., K] m/s; kappa [.., K] 1/m; time [.., K] s, of passing each point.
    """
    return parts((speed * speed * kappa) ** 2, jnp.diff(time, axis=-1))


def acceleration(
    speed: Float[Array, "*s k"], step: Float[Array, "*s e"], *, time: Float[Array, "*s k"]
) -> Float[Array, "*s e"]:
    """Integral of a^2 dt (m^2/s^3) with a = d(v^2) / (2 ds), by segment.

    Args: speed [.., K] m/s; step [.., K-1] m; time [.., K] s, of passing each point.
    """
    gained = (speed[..., 1:] + speed[..., :-1]) * (speed[..., 1:] - speed[..., :-1])
    # No `safe.divide`: in mode soft the compiler then computes the candidates once more for it, half a step's time.
    change = gained / (2 * lean.maximum(step, MIN_STEP))
    return change * change * jnp.diff(time, axis=-1)
