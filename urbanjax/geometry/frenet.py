"""The Frenet frame of a reference line that is tabulated at uniform stations, and curves offset from it.

Between two stations the position is the cubic Hermite curve of the positions and headings (continuous with its
tangent); heading and curvature are linear. Queries may have any shape.
"""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, Int

from urbanjax.numerics import lean, polynomial, safe
from urbanjax.types import pytree

MIN_SCALE = 0.2  # of 1 - kappa d: an offset curve does not come nearer to the reference's centre of curvature


@pytree
class Reference:
    """The reference line at some stations."""

    position: Array  # [*q, 2] m
    heading: Array  # [*q] rad
    curvature: Array  # [*q] 1/m


@pytree
class Line:
    """A reference line and C quantities along it at uniform stations, in one table: look-ups cost by their number."""

    rows: Array  # [n, 3 + C] x, y (m), heading (rad, unwrapped), and what else there is
    start: float | Array  # [] m, the first station
    spacing: float | Array  # [] m


@pytree
class Cell:
    """Where stations lie between two rows of a table."""

    before: Array  # [*q, 3 + C], the row at or before the station
    after: Array  # [*q, 3 + C], the next one
    fraction: Array  # [*q] 0 to 1, of the way between them
    beyond: Array  # [*q] m past an end of the table, signed
    spacing: float | Array  # m between the two, [] or [*q]

    @property
    def bend(self) -> Array:
        """Change of the heading by station [*q] rad/m; beyond an end 0."""
        turn = (self.after[..., 2] - self.before[..., 2]) / self.spacing
        return lean.where(self.beyond == 0, turn, 0.0)

    @property
    def nearest(self) -> Array:
        """The nearer of the two rows [*q, 3 + C]."""
        later = jnp.broadcast_to(self.fraction[..., None] > 0.5, self.after.shape)
        return lean.where(later, self.after, self.before)


@pytree
class Reading:
    """What a table says of places."""

    x: Array  # [*q] m
    y: Array  # [*q] m
    heading: Array  # [*q] rad
    cos: Array  # [*q] of the heading
    sin: Array  # [*q]
    others: Array  # [*q, C], what else there is

    @property
    def position(self) -> Array:
        """Points [*q, 2] m."""
        return jnp.stack([self.x, self.y], axis=-1)


def tabulated(
    position: Float[Array, "n 2"],
    heading: Float[Array, "n"],
    *others: Float[Array, "n"] | Float[Array, "n _"],
    start: float | Float[Array, ""],
    spacing: float | Float[Array, ""],
) -> Line:
    """The table of a line from its position (m) and heading (rad, unwrapped), and of what is read with them.

    Args: position [n, 2] m; heading [n] rad, unwrapped; others [n] or [n, c]; start m, first station; spacing m.
    """
    columns = [x if x.ndim == 2 else x[:, None] for x in (position, heading, *others)]
    return Line(jnp.concatenate(columns, axis=1), start, spacing)


def cell(
    start: float | Float[Array, ""], spacing: float | Float[Array, "..."], *, n: int, station: Float[Array, "*q"]
) -> tuple[Int[Array, "*q"], Float[Array, "*q"], Float[Array, "*q"]]:
    """Interval of the grid at each station (0 to n - 2), fraction within it (0 to 1), and metres beyond an end, signed.

    Args: start m, first station; spacing m; n, number of grid stations; station [*q] m.
    """
    steps = (station - start) / spacing
    inside = lean.clip(steps, 0.0, n - 1.0)
    index = lean.clip(inside.astype(jnp.int32), 0, n - 2)
    return index, inside - index.astype(inside.dtype), (steps - inside) * spacing


def locate(line: Line, station: Float[Array, "*q"]) -> Cell:
    """Where stations [m] lie on a line. Args: line, the table; station [*q] m."""
    index, fraction, beyond = cell(line.start, line.spacing, n=line.rows.shape[0], station=station)
    return Cell(lean.rows(line.rows, index), lean.rows(line.rows, index + 1), fraction, beyond, line.spacing)


def read(place: Cell) -> Reading:
    """The line at places: the cubic Hermite curve of positions and headings, all else linear; straight on beyond.

    Args: place [*q], between rows of a table.
    """
    f = place.fraction
    mixed = linear(place.before, place.after, fraction=f)
    heading = mixed[..., 2]
    cos, sin = jnp.cos(heading), jnp.sin(heading)
    (x0, y0, angle0), (x1, y1, angle1) = (jnp.unstack(row[..., :3], axis=-1) for row in (place.before, place.after))
    begin, end, out, back = polynomial.hermite(f)

    def along(value0: Array, value1: Array, slope0: Array, slope1: Array, direction: Array) -> Array:
        bend = place.spacing * (out * slope0 + back * slope1)
        return begin * value0 + end * value1 + bend + place.beyond * direction

    return Reading(
        x=along(x0, x1, jnp.cos(angle0), jnp.cos(angle1), cos),
        y=along(y0, y1, jnp.sin(angle0), jnp.sin(angle1), sin),
        heading=heading,
        cos=cos,
        sin=sin,
        others=mixed[..., 3:],
    )


def linear(
    before: Float[Array, "*q c"], after: Float[Array, "*q c"], *, fraction: Float[Array, "*q"]
) -> Float[Array, "*q c"]:
    """Rows between two others. Args: before, after [*q, c]; fraction [*q], of the way from one to the other."""
    weight = fraction[..., None]
    return before * (1 - weight) + after * weight


def sample(
    position: Float[Array, "n 2"],
    heading: Float[Array, "n"],
    *,
    curvature: Float[Array, "n"],
    start: float | Float[Array, ""],
    spacing: float,
    station: Float[Array, "*q"],
) -> Reference:
    """The reference line at the stations; beyond an end it goes straight on (its curvature fades within one spacing).

    Args: position [n, 2] m, heading [n] rad, unwrapped, and curvature [n] 1/m at stations start + spacing * k (m);
    station [*q] m.
    """
    place = locate(tabulated(position, heading, curvature, start=start, spacing=spacing), station)
    at = read(place)
    fade = lean.maximum(1 - jnp.abs(place.beyond) / spacing, 0)
    return Reference(at.position, at.heading, fade * at.others[..., 0])


def scale(curvature: Array, offset: Array) -> Array:
    """1 - kappa d, metres at an offset d [m] per metre of a line of curvature kappa [1/m]; not less than MIN_SCALE.

    Args: curvature [*q] 1/m; offset [*q] m.
    """
    return lean.maximum(1 - curvature * offset, MIN_SCALE)


def to_world(reference: Reference, offset: Float[Array, "*q"]) -> Float[Array, "*q 2"]:
    """Positions [m] at a lateral offset [m] from the reference line, left positive.

    Args: reference, the line at stations [*q]; offset [*q] m.
    """
    x, y = jnp.unstack(reference.position, axis=-1)
    cos, sin = jnp.cos(reference.heading), jnp.sin(reference.heading)
    return jnp.stack([x - offset * sin, y + offset * cos], axis=-1)


def offset_curve(
    heading: Float[Array, "*q"],
    curvature: Float[Array, "*q"],
    *,
    offset: Float[Array, "*q"],
    slope: Float[Array, "*q"],
    bend: Float[Array, "*q"],
    curvature_slope: Float[Array, "*q"] | None = None,
) -> tuple[Float[Array, "*q"], Float[Array, "*q"]]:
    """Heading [rad] and curvature [1/m] of the curve d(s) beside a reference line (Werling et al. 2010).

        heading = theta_r + atan(d' / (1 - kappa_r d))
        curvature = ((d'' + (kappa_r' d + kappa_r d') tan) cos^2 / (1 - kappa_r d) + kappa_r) cos / (1 - kappa_r d)

    with tan and cos of the heading difference. The frame ends where 1 - kappa_r d reaches 0, the centre of curvature;
    it is held at MIN_SCALE, so the result is finite but means nothing beyond (not differentiable at that bound).
    Args: heading [*q] rad and curvature [*q] 1/m of the reference; offset d [*q] m; slope d' [*q]; bend d'' [*q] 1/m;
    curvature_slope kappa_r' [*q] 1/m^2, 0 if not given.
    """
    size = scale(curvature, offset)
    twist = curvature * slope if curvature_slope is None else curvature * slope + curvature_slope * offset
    length = safe.sqrt(size * size + slope * slope)  # of the offset curve per metre of reference
    cos, tan = size / length, slope / size
    bent = ((bend + twist * tan) * cos * cos / size + curvature) * cos / size
    return heading + safe.arctan(tan), bent


def offset_length(
    curvature: Float[Array, "*q"], offset: Float[Array, "*q"], *, slope: Float[Array, "*q"]
) -> Float[Array, "*q"]:
    """Metres of the offset curve per metre of reference line, sqrt((1 - kappa d)^2 + d'^2).

    Args: curvature kappa [*q] 1/m; offset d [*q] m; slope d' [*q].
    """
    size = 1 - curvature * offset
    return safe.sqrt(size * size + slope * slope)
