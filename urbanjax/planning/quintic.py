"""Quintics from the vehicle's state to end states, read off at the stations of a common grid (Eq. 16-18)."""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.numerics import polynomial, safe
from urbanjax.planning import shape
from urbanjax.planning.corridor import Corridor
from urbanjax.roadmap.extended import Progress
from urbanjax.types import VehicleState, pytree

NEWTON_STEPS = 4
MIN_RATE = 0.3  # m/s along the road, less does not count as getting on
MIN_SPEED = 0.5  # m/s, below which the curvature of x(t), y(t) is ill-conditioned
MAX_TURN = 1.3  # rad from the road's direction


@pytree
class EndState:
    """Where and how each of J candidates joins the neighbourhood of the macro plan."""

    station: Array  # [J] m along the route
    length: Array  # [J] m from the start
    duration: Array  # [J] s
    beside: Array  # [J] m, lateral difference from the macro plan
    speed: Array  # [J] m/s
    offset: Array  # [J] m, lateral offset from the reference line
    slope: Array  # [J] its derivative by station
    bend: Array  # [J] 1/m, its second derivative


@pytree
class Lateral:
    """Lateral profiles of J candidates at K stations, with the time and speed at which each is passed."""

    offset: Array  # [J, K] m
    slope: Array  # [J, K]
    bend: Array  # [J, K] 1/m
    time: Array  # [J, K] s
    speed: Array  # [J, K] m/s


def boundary(
    speed: Array, acceleration: Array, heading: Array, curvature: Array
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """First and second derivatives of (x, y) by time: along the heading, and v^2 kappa across it."""
    cos, sin = jnp.cos(heading), jnp.sin(heading)
    across = speed * speed * curvature
    return (speed * cos, acceleration * cos - across * sin), (speed * sin, acceleration * sin + across * cos)


def planar(state: VehicleState, curvature: Array, end: EndState, at_end: Corridor, road: Corridor) -> Lateral:
    """Candidates as x(t), y(t) (Eq. 16), at the moments when they cross the reference line's normals.

    Each crossing is found by Newton steps on the polynomials, so position, heading and curvature are exact, without
    interpolation. Args: curvature [] 1/m at the start; at_end, the road at each end state [J]; road, at the grid [K].
    """
    cx, cy = coefficients(state, curvature, end, at_end)
    px, py = road.position[None, :, 0] - state.position[0], road.position[None, :, 1] - state.position[1]
    cos, sin = jnp.cos(road.heading)[None, :], jnp.sin(road.heading)[None, :]
    duration = end.duration[:, None]

    def newton(t: Array) -> Array:
        x, vx, _ = polynomial.evaluate(cx, t)
        y, vy, _ = polynomial.evaluate(cy, t)
        miss = (x - px) * cos + (y - py) * sin
        return jnp.clip(t - miss / jnp.maximum(vx * cos + vy * sin, MIN_RATE), 0, duration)

    t, _ = _uniform(state.speed, end, road.station - road.station[0])
    t = jnp.minimum(t, duration)
    for _ in range(NEWTON_STEPS - 1):
        t = newton(t)
    # The last step from a converged, constant moment carries the exact derivative (implicit function theorem).
    t = newton(jax.lax.stop_gradient(t))

    x, vx, ax = polynomial.evaluate(cx, t)
    y, vy, ay = polynomial.evaluate(cy, t)
    squared = jnp.maximum(vx * vx + vy * vy, MIN_SPEED**2)
    speed = jnp.sqrt(squared)
    tangent = (vy * cos - vx * sin) / jnp.maximum(vx * cos + vy * sin, MIN_RATE)
    offset = (y - py) * cos - (x - px) * sin
    kappa = road.curvature[None, :]
    slope, bend = shape.from_plane(kappa, offset, tangent, (vx * ay - vy * ax) / (squared * speed))
    return Lateral(offset=offset, slope=slope, bend=bend, time=t, speed=speed)


def coefficients(
    state: VehicleState, curvature: Array, end: EndState, at_end: Corridor
) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    """Coefficients [J, 1] of x(t) and y(t) relative to the vehicle's position (Eq. 17-18).

    At both ends position, velocity and acceleration are matched, the acceleration across being v^2 kappa.
    """
    heading, end_curvature = shape.to_plane(at_end.heading, at_end.curvature, end.offset, end.slope, end.bend)
    # A vehicle that brakes to standstill before the end of the primitive would have to come back.
    acceleration = jnp.maximum(state.acceleration, -state.speed / end.duration)
    (vx, ax), (vy, ay) = boundary(state.speed, acceleration, state.heading, curvature)
    (wx, bx), (wy, by) = boundary(end.speed, jnp.zeros_like(end.speed), heading, end_curvature)
    x = at_end.position[:, 0] - end.offset * jnp.sin(at_end.heading) - state.position[0]
    y = at_end.position[:, 1] + end.offset * jnp.cos(at_end.heading) - state.position[1]
    ones = jnp.ones_like(x)
    cx = polynomial.quintic((0 * ones, vx * ones, ax), (x, wx, bx), end.duration)
    cy = polynomial.quintic((0 * ones, vy * ones, ay), (y, wy, by), end.duration)
    return tuple(c[:, None] for c in cx), tuple(c[:, None] for c in cy)


def stationwise(progress: Progress, state: VehicleState, curvature: Array, end: EndState, road: Corridor) -> Lateral:
    """Candidates as d(s): a quintic of station, well defined down to standstill, with uniform acceleration."""
    tangent = jnp.tan(jnp.clip(progress.heading_error, -MAX_TURN, MAX_TURN))
    slope, bend = shape.from_plane(road.curvature[0], progress.offset, tangent, curvature)
    ones = jnp.ones_like(end.offset)
    start = (progress.offset * ones, slope * ones, bend * ones)
    c = polynomial.quintic(start, (end.offset, end.slope, end.bend), end.length)
    ahead = road.station - road.station[0]
    along = jnp.minimum(ahead[None, :], end.length[:, None])
    offset, first, second = polynomial.evaluate(tuple(a[:, None] for a in c), along)
    time, speed = _uniform(state.speed, end, ahead)
    return Lateral(offset=offset, slope=first, bend=second, time=time, speed=speed)


def _uniform(start_speed: Array, end: EndState, ahead: Float[Array, "k"]) -> tuple[Array, Array]:
    """Time [J, K] (s) and speed [J, K] (m/s) at constant acceleration from the start speed to the end speed."""
    share = jnp.minimum(ahead[None, :] / end.length[:, None], 1)
    squared = start_speed**2 + (end.speed[:, None] ** 2 - start_speed**2) * share
    speed = safe.sqrt(squared)
    return safe.divide(2 * share * end.length[:, None], start_speed + speed), speed
