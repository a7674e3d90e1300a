"""Quintics from the vehicle's state to end states, read off at the stations of a common grid (Eq. 16-18)."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.numerics import lean, polynomial, safe
from urbanjax.numerics.kept import kept
from urbanjax.planning import shape
from urbanjax.planning.cross_section import CrossSections
from urbanjax.roadmap.progress import Progress
from urbanjax.types import VehicleState, pytree

NEWTON_STEPS = 3  # and a last one that carries the derivative
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
    acceleration: Array  # [J] m/s^2
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
    speed: Array, acceleration: Array, *, heading: Array, curvature: Array
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """First and second derivatives of (x, y) by time: along the heading, and v^2 kappa across it.

    Args: speed m/s; acceleration m/s^2, along the heading; heading rad; curvature 1/m; of shapes
    that broadcast.
    """
    cos, sin = jnp.cos(heading), jnp.sin(heading)
    across = speed * speed * curvature
    return (speed * cos, acceleration * cos - across * sin), (speed * sin, acceleration * sin + across * cos)


def planar(
    state: VehicleState, curvature: Array, *, end: EndState, at_end: CrossSections, road: CrossSections
) -> Lateral:
    """Candidates as x(t), y(t) (Eq. 16), at the moments when they cross the reference line's normals.

    Each crossing is found by Newton steps on the polynomials, so position, heading and curvature are exact, without
    interpolation. Args: state, of the ego; curvature [] 1/m, at the start; end [J], the end states; at_end, the road at
    each of them; road, at the grid [K].
    """
    c, duration = coefficients(state, curvature, end=end, at_end=at_end), end.duration[:, None]
    p = road.position[None] - state.position[None, None]
    lines = (c, p, jnp.cos(road.heading)[None], jnp.sin(road.heading)[None], duration)
    guess, _ = _uniform(state.speed, end, road.station - road.station[0])
    # The search carries no derivative: one more step from its result has the exact one (implicit function theorem).
    fixed, share = jax.lax.stop_gradient((lines, lean.minimum(guess / duration, 1)))
    share = kept(jax.lax.fori_loop(0, NEWTON_STEPS, lambda _, share: _towards(fixed, share), share))
    share = _towards(lines, share)

    _, p, cos, sin, _ = lines
    at = read(c, share)
    (x, y), (vx, vy), (ax, ay) = ((at[..., 0, i] / duration**i, at[..., 1, i] / duration**i) for i in range(3))
    squared = lean.maximum(vx * vx + vy * vy, MIN_SPEED**2)
    speed = jnp.sqrt(squared)
    tangent = (vy * cos - vx * sin) / lean.maximum(vx * cos + vy * sin, MIN_RATE)
    offset = (y - p[..., 1]) * cos - (x - p[..., 0]) * sin
    kappa = road.curvature[None, :]
    slope, bend = shape.from_plane(kappa, offset, tangent, (vx * ay - vy * ax) / (squared * speed))
    return Lateral(offset=offset, slope=slope, bend=bend, time=share * duration, speed=speed)


def _towards(lines: tuple[Array, ...], share: Array) -> Array:
    """One Newton step for the shares [J, K] of the duration at which the reference line's normals are crossed."""
    c, p, cos, sin, duration = lines
    (x, vx), (y, vy) = (_horner(jnp.unstack(c[:, :, n, None], axis=1), share) for n in range(2))
    px, py = jnp.unstack(p, axis=-1)
    miss = (x - px) * cos + (y - py) * sin
    rate = vx * cos + vy * sin
    return lean.clip(share - miss / lean.maximum(rate, MIN_RATE * duration), 0.0, 1.0)


def _horner(c: Sequence[Array], share: Array) -> tuple[Array, Array]:
    """Value and first derivative of polynomials with the coefficients [J, 1] at each share [J, K]."""
    value, slope = c[-1] * share + c[-2], c[-1]
    for lower in reversed(c[:-2]):
        value, slope = value * share + lower, slope * share + value
    return value, slope


def coefficients(
    state: VehicleState, curvature: Array, *, end: EndState, at_end: CrossSections
) -> Float[Array, "j 6 2"]:
    """Coefficients [J, 6, 2] of x and y, relative to the vehicle's position, by the share of the duration (Eq. 17-18).

    At both ends position, velocity and acceleration are matched, the acceleration across being v^2 kappa. Args: state,
    of the ego; curvature [] 1/m, at the start; end [J], the end states; at_end, the road at each of them.
    """
    heading, end_curvature = shape.to_plane(at_end.heading, at_end.curvature, end.offset, end.slope, end.bend)
    # A vehicle that brakes to standstill before the end of the primitive would have to come back.
    acceleration = lean.maximum(state.acceleration, -state.speed / end.duration)
    (vx, ax), (vy, ay) = boundary(state.speed, acceleration, heading=state.heading, curvature=curvature)
    (wx, bx), (wy, by) = boundary(end.speed, end.acceleration, heading=heading, curvature=end_curvature)
    x = at_end.position[:, 0] - end.offset * jnp.sin(at_end.heading) - state.position[0]
    y = at_end.position[:, 1] + end.offset * jnp.cos(at_end.heading) - state.position[1]
    t, zero = end.duration, jnp.zeros_like(x)
    cx = polynomial.quintic((zero, vx * t, ax * t * t), (x, wx * t, bx * t * t), duration=jnp.ones_like(t))
    cy = polynomial.quintic((zero, vy * t, ay * t * t), (y, wy * t, by * t * t), duration=jnp.ones_like(t))
    return jnp.stack([jnp.stack(cx, axis=1), jnp.stack(cy, axis=1)], axis=-1)


def read(c: Float[Array, "j 6 n"], share: Float[Array, "j k"]) -> Float[Array, "j k n 3"]:
    """Value, first and second derivative [J, K, n, 3] of n polynomials at each share of their range.

    As a product of powers and coefficients: half the compile time of Horner's rule where gradients are taken.
    Args: c [J, 6, n], coefficients from the constant up; share [J, K], 0 to 1.
    """
    return _read(c, share)


@jax.custom_jvp
def _read(c: Array, share: Array) -> Array:
    return _values(c, _powers(share), count=3)


@_read.defjvp
def _read_jvp(primals: tuple[Array, Array], tangents: tuple[Array, Array]) -> tuple[Array, Array]:
    """Each of the three has the next one for its derivative: none is taken of the powers."""
    (c, share), (change, shift) = primals, tangents
    powers = _powers(share)
    at = _values(c, powers, count=4)
    # Each by itself: a sum over so few at the end of an array would take long.
    moved = [jnp.stack([at[:, :, n, d] * shift for d in (1, 2, 3)], axis=-1) for n in range(at.shape[2])]
    return at[..., :3], _values(change, powers, count=3) + jnp.stack(moved, axis=2)


def _powers(share: Float[Array, "j k"]) -> Float[Array, "j k 6"]:
    square = share * share
    cube = square * share
    return jnp.stack([jnp.ones_like(share), share, square, cube, square * square, square * cube], axis=-1)


def _values(c: Float[Array, "j 6 n"], powers: Float[Array, "j k 6"], *, count: int) -> Float[Array, "j k n d"]:
    """Value and derivatives [J, K, n, D] of polynomials. Args: c, coefficients; powers, of the shares; count D."""
    order = jnp.arange(1, 6).astype(c.dtype)[None, :, None]
    last, table = jnp.zeros_like(c[:, :1]), [c]
    for _ in range(count - 1):
        table.append(jnp.concatenate([table[-1][:, 1:] * order, last], axis=1))
    return jnp.einsum("jki,jind->jknd", powers, jnp.stack(table, axis=-1), precision=jax.lax.Precision.HIGHEST)


def stationwise(
    progress: Progress, state: VehicleState, *, curvature: Array, end: EndState, road: CrossSections
) -> Lateral:
    """Candidates as d(s): a quintic of station, well defined down to standstill, with uniform acceleration.

    Args: progress, of the ego along the route; state, of the ego; curvature [] 1/m, at the start; end [J], the end
    states; road, at the grid [K].
    """
    tangent = jnp.tan(lean.clip(progress.heading_error, -MAX_TURN, MAX_TURN))
    slope, bend = shape.from_plane(road.curvature[0], progress.offset, tangent, curvature)
    ones, size = jnp.ones_like(end.offset), end.length
    start = (progress.offset * ones, slope * size, bend * size * size)
    c = polynomial.quintic(start, (end.offset, end.slope * size, end.bend * size * size), duration=ones)
    ahead = road.station - road.station[0]
    at = read(jnp.stack(c, axis=1)[..., None], lean.minimum(ahead[None, :] / size[:, None], 1))[:, :, 0]
    time, speed = _uniform(state.speed, end, ahead)
    size = size[:, None]
    return Lateral(offset=at[..., 0], slope=at[..., 1] / size, bend=at[..., 2] / size**2, time=time, speed=speed)


def _uniform(start_speed: Array, end: EndState, ahead: Float[Array, "k"]) -> tuple[Array, Array]:
    """Time [J, K] (s) and speed [J, K] (m/s) at constant acceleration from the start speed to the end speed."""
    share = lean.minimum(ahead[None, :] / end.length[:, None], 1)
    squared = start_speed**2 + (end.speed[:, None] ** 2 - start_speed**2) * share
    speed = safe.sqrt(squared)
    return safe.divide(2 * share * end.length[:, None], start_speed + speed), speed
