"""Oriented boxes and the gap between them.

The gap is the separating-axis one: along each of the four face normals, the distance between the centres less the two
half extents, and of these the largest. Its sign is exact: positive if and only if the boxes are apart, zero when they
touch. A positive gap is a lower bound of the Euclidean distance (equal to it unless corner faces corner), and a
negative one is minus the depth of penetration, the shortest move that parts them.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from urbanjax.numerics import soft
from urbanjax.numerics.once import once
from urbanjax.numerics.soft import Relaxation
from urbanjax.types import pytree


@pytree
class Box:
    """Boxes as separate scalars, of shapes that broadcast: arithmetic on them fuses into one vectorised loop.

    It is fastest with the longest axis (candidates) last, reduced over leading ones (objects, times).
    """

    x: Array  # [*s] m, centre
    y: Array  # [*s] m, centre
    cos: Array  # [*s] cosine of the heading
    sin: Array  # [*s] sine of the heading
    half_length: Array  # [*s] m
    half_width: Array  # [*s] m


def box(position: Float[Array, "*s 2"], heading: Float[Array, "*s"], *, length: Array, width: Array) -> Box:
    """Boxes from their centres. Args: position [*s, 2] m; heading [*s] rad; length and width m, broadcastable to it."""
    x, y = position[..., 0], position[..., 1]
    return Box(x, y, jnp.cos(heading), jnp.sin(heading), length / 2, width / 2)


def corners(box: Box) -> Float[Array, "*s 4 2"]:
    """Corners [*s, 4, 2] m, counter-clockwise from the front left. Args: box, of shape [*s]."""
    along = jnp.stack([box.half_length, -box.half_length, -box.half_length, box.half_length], axis=-1)
    across = jnp.stack([box.half_width, box.half_width, -box.half_width, -box.half_width], axis=-1)
    x, y, cos, sin = (jnp.expand_dims(v, -1) for v in (box.x, box.y, box.cos, box.sin))
    return jnp.stack([x + along * cos - across * sin, y + along * sin + across * cos], axis=-1)


@jax.custom_jvp
def _soft_abs(x: Array, width: Array) -> Array:
    """|x|, rounded to a parabola within `width` of 0: at most width/2 above |x|, and once differentiable."""
    near = jnp.minimum(jnp.maximum(x, -width), width)
    return near * (x - 0.5 * near) / width + 0.5 * width


@_soft_abs.defjvp
def _soft_abs_jvp(primals: tuple[Array, Array], tangents: tuple[Array, Array]) -> tuple[Array, Array]:
    (x, width), (change, wider) = primals, tangents
    slope = jnp.clip(x / width, -1, 1)
    return _soft_abs(x, width), slope * change + 0.5 * (1 - slope * slope) * wider


def _axis_gaps(a: Box, b: Box, size: Callable[[Array], Array]) -> tuple[Array, Array, Array, Array]:
    """Signed gap along the forward and left axes of a and of b, with `size` for the absolute value."""
    dx, dy = b.x - a.x, b.y - a.y
    cos = a.cos * b.cos + a.sin * b.sin  # of the angle between the boxes
    sin = a.cos * b.sin - a.sin * b.cos
    return (
        size(dx * a.cos + dy * a.sin) - a.half_length - size(b.half_length * cos) - size(b.half_width * sin),
        size(dy * a.cos - dx * a.sin) - a.half_width - size(b.half_length * sin) - size(b.half_width * cos),
        size(dx * b.cos + dy * b.sin) - b.half_length - size(a.half_length * cos) - size(a.half_width * sin),
        size(dy * b.cos - dx * b.sin) - b.half_width - size(a.half_length * sin) - size(a.half_width * cos),
    )


def box_gap(a: Box, b: Box) -> Array:
    """Signed separating-axis gap [m] between boxes of broadcastable shapes.

    Positive: apart, a lower bound of the Euclidean distance. Negative: minus the depth of penetration. Not
    differentiable where two axes tie, a centre lies on the other box's axis or the boxes are parallel; there the
    derivative is a finite one-sided or mean one. Args: a, b, boxes, in any order.
    """
    forward_a, left_a, forward_b, left_b = _axis_gaps(a, b, jnp.abs)
    return jnp.maximum(jnp.maximum(forward_a, left_a), jnp.maximum(forward_b, left_b))


def soft_box_gap(a: Box, b: Box, *, temperature: float | Array) -> Array:
    """Smooth twin of `box_gap` [m]: T log sum exp(gap_i / T) over the four axes, with |.| rounded within T of zero.

    It lies in [gap - T, gap + T (log 4 + 1/2)] and tends to `box_gap` with T -> 0.
    Args: a, b, boxes; temperature T [m] > 0.
    """
    # Of the shape of the gaps: the derivatives by it are added up before they are summed, and not sum by sum.
    width = jnp.broadcast_to(jnp.asarray(temperature, a.x.dtype), jnp.broadcast_shapes(a.cos.shape, b.cos.shape))
    return _soft_gap(a, b, width)


@jax.custom_jvp
def _soft_gap(a: Box, b: Box, width: Array) -> Array:
    gaps = _axis_gaps(a, b, lambda x: _soft_abs(x, width))
    top = jnp.maximum(jnp.maximum(gaps[0], gaps[1]), jnp.maximum(gaps[2], gaps[3]))
    first, *others = (jnp.exp((gap - top) / width) for gap in gaps)
    return top + width * jnp.log(sum(others, start=first))


@_soft_gap.defjvp
def _soft_gap_jvp(primals: tuple[Box, Box, Array], tangents: tuple[Box, Box, Array]) -> tuple[Array, Array]:
    """By hand: what automatic differentiation makes of it is fused so that each exponential is computed a dozen times.

    With p the softmax of the four gaps and s the slope of |.|, the derivatives are sums of products of few of them.
    """
    (a, b, width), (da, db, wider) = primals, tangents
    dx, dy = b.x - a.x, b.y - a.y
    cos, sin = a.cos * b.cos + a.sin * b.sin, a.cos * b.sin - a.sin * b.cos
    sizes = (
        (dx * a.cos + dy * a.sin, b.half_length * cos, b.half_width * sin),
        (dy * a.cos - dx * a.sin, b.half_length * sin, b.half_width * cos),
        (dx * b.cos + dy * b.sin, a.half_length * cos, a.half_width * sin),
        (dy * b.cos - dx * b.sin, a.half_length * sin, a.half_width * cos),
    )
    extents = (a.half_length, a.half_width, b.half_length, b.half_width)
    gaps = once(
        *(
            _soft_abs(u, width) - own - _soft_abs(v, width) - _soft_abs(w, width)
            for (u, v, w), own in zip(sizes, extents, strict=True)
        )
    )
    top = jnp.maximum(jnp.maximum(gaps[0], gaps[1]), jnp.maximum(gaps[2], gaps[3]))
    shares = once(*(jnp.exp((gap - top) / width) for gap in gaps))
    total = shares[0] + shares[1] + shares[2] + shares[3]
    log, p1, p2, p3, p4 = once(jnp.log(total), *(share / total for share in shares))
    p = (p1, p2, p3, p4)
    slopes = [[jnp.clip(x / width, -1, 1) for x in three] for three in sizes]
    q = once(*(weight * three[0] for weight, three in zip(p, slopes, strict=True)))
    v1, v2, v3, v4, w1, w2, w3, w4 = once(
        *(weight * three[k] for k in (1, 2) for weight, three in zip(p, slopes, strict=True))
    )
    by_x = q[0] * a.cos - q[1] * a.sin + q[2] * b.cos - q[3] * b.sin
    by_y = q[0] * a.sin + q[1] * a.cos + q[2] * b.sin + q[3] * b.cos
    by_cos = -(v1 * b.half_length + w2 * b.half_width + v3 * a.half_length + w4 * a.half_width)
    by_sin = -(w1 * b.half_width + v2 * b.half_length + w3 * a.half_width + v4 * a.half_length)
    rounding = sum(
        (
            weight * 0.5 * ((1 - x[0] ** 2) - (1 - x[1] ** 2) - (1 - x[2] ** 2))
            for weight, x in zip(p, slopes, strict=True)
        ),
        start=jnp.zeros_like(log),
    )
    spread = sum((weight * (gap - top) for weight, gap in zip(p, gaps, strict=True)), start=jnp.zeros_like(log)) / width
    by = once(
        by_x,
        by_y,
        q[0] * dx + q[1] * dy + by_cos * b.cos + by_sin * b.sin,
        q[0] * dy - q[1] * dx + by_cos * b.sin - by_sin * b.cos,
        q[2] * dx + q[3] * dy + by_cos * a.cos - by_sin * a.sin,
        q[2] * dy - q[3] * dx + by_cos * a.sin + by_sin * a.cos,
        -p1 - v3 * cos - v4 * sin,
        -p2 - w3 * sin - w4 * cos,
        -p3 - v1 * cos - v2 * sin,
        -p4 - w1 * sin - w2 * cos,
        log - spread + rounding,
    )
    changes = (
        db.x - da.x, db.y - da.y, da.cos, da.sin, db.cos, db.sin,
        da.half_length, da.half_width, db.half_length, db.half_width, wider,
    )  # fmt: skip
    change = sum((each * along for each, along in zip(by, changes, strict=True)), start=jnp.zeros_like(log))
    return top + width * log, change


def relaxed_box_gap(a: Box, b: Box, *, relaxation: Relaxation, scale: float | Array = 1.0) -> Array:
    """`box_gap` [m] in the relaxation's mode.

    Args: a, b, boxes; relaxation, hard or how soft; scale, the difference in gap that counts as clear [m].
    """
    if relaxation.mode == "hard":
        return box_gap(a, b)
    temperature = relaxation.temperature * scale
    return soft.combine(
        lambda: box_gap(a, b), lambda: soft_box_gap(a, b, temperature=temperature), relaxation=relaxation
    )


def overlap(a: Box, b: Box) -> Bool[Array, "..."]:
    """Whether boxes of broadcastable shapes share a point; touching counts. Args: a, b, boxes."""
    return box_gap(a, b) <= 0
