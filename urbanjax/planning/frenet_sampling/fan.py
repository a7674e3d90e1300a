"""Candidate trajectories in the plane, from the Frenet frame of a reference line (Werling et al. 2010)."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.geometry import frenet
from urbanjax.numerics import safe
from urbanjax.numerics.once import once
from urbanjax.planning.frenet_sampling import motion
from urbanjax.planning.frenet_sampling.line import ReferenceLine
from urbanjax.planning.frenet_sampling.motion import Across, Along, EndGrid, FrenetState, per_way
from urbanjax.types import pytree

FIELDS = ("x", "y", "heading", "speed", "curvature", "acceleration")


@pytree
class FrenetFan:
    """D * V * A * N candidates of T points; the offset changes slowest, the duration fastest."""

    along: Along
    across: Across
    values: Array  # [6, D, V * A, N, T] by FIELDS, one array since memory is taken faster at once

    @property
    def position(self) -> Array:
        """[2, D, V * A, N, T] m."""
        return self.values[:2]

    @property
    def heading(self) -> Array:
        """[D, V * A, N, T] rad."""
        return self.values[2]

    @property
    def speed(self) -> Array:
        """[D, V * A, N, T] m/s."""
        return self.values[3]

    @property
    def curvature(self) -> Array:
        """[D, V * A, N, T] 1/m."""
        return self.values[4]

    @property
    def acceleration(self) -> Array:
        """[D, V * A, N, T] m/s^2, along the path."""
        return self.values[5]


def generate(line: ReferenceLine, state: FrenetState, *, grid: EndGrid) -> FrenetFan:
    """All candidates: a quartic s(t) to each end speed and acceleration, a quintic d to each offset.

    With `lateral` "station" d is a quintic of the way covered, which is well defined down to standstill. Past its
    duration a candidate goes on at its end speed and offset. Differentiable in the state and the line.
    Args: line, the reference; state, where the candidates begin; grid, of their ends.
    """
    along = motion.along(line, state.station, grid=grid)
    across = motion.across(along, state.offset, grid=grid)
    return FrenetFan(along, across, cartesian(along, across, grid=grid))


def cartesian(along: Along, across: Across, *, grid: EndGrid) -> Float[Array, "6 d v n t"]:
    """Position (m), heading (rad), speed (m/s), curvature (1/m) and acceleration (m/s^2) by FIELDS.

    The exact relations of a curve d(s) beside the line; with `heading` "slope" those of planners that take d' itself as
    the tangent of the heading, which is the same on a straight line. No square root or division meets zero.
    Args: along and across, the motions; grid, of their ends.
    """
    wide, foot = (across.offset.shape[0], *along.station.shape), along.foot

    def of(values: Array) -> Array:  # one axis for duration and time: the compiler's inner loops are long
        lead = values.shape[:-2] if values.ndim == 4 else (1, values.shape[0])
        return values.reshape(*lead, -1)

    offset, slope, bend = (of(v) for v in (across.offset, across.first, across.second))
    speed, kappa, twist = (of(v) for v in (along.speed, foot.curvature, foot.curvature_slope))
    if grid.lateral == "time":
        rate = per_way(speed)
        slope = slope * rate
        bend = (bend - slope * of(along.acceleration)) * rate * rate
    scale = frenet.scale(kappa, offset)
    turn = kappa * slope + twist * offset  # the derivative of -scale
    tan = slope if grid.heading == "slope" else slope / scale
    secant = jnp.sqrt(1 + tan * tan)
    stretch = scale * secant  # metres of candidate per metre of line
    inverse = 1 / stretch
    bent = (bend + turn * tan) * scale * inverse * inverse
    growth = secant * (scale * tan * bent - turn)
    values = (
        of(foot.x) - offset * of(foot.sin),
        of(foot.y) + offset * of(foot.cos),
        of(foot.heading) + safe.arctan(tan),
        speed * stretch,
        (kappa + bent) * inverse,
        of(along.acceleration) * stretch + speed * speed * growth,
    )
    fields = jnp.stack(once(*(jnp.broadcast_to(v, (*wide[:2], wide[2] * wide[3])) for v in values)))
    return fields.reshape(len(FIELDS), *wide)
