"""A path through a course's lattice, read off along its edges."""

import functools
import operator

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, Int

from urbanjax.geometry import frenet
from urbanjax.planning import shape
from urbanjax.planning.lattice.course_lattice import CourseLattice
from urbanjax.planning.lattice.edges import quintic_basis
from urbanjax.roadmap.corridor import Corridor
from urbanjax.types import Path


def driven(corridor: Corridor, lattice: CourseLattice, *, nodes: Int[Array, "s"], samples: int) -> Path:
    """The path along the edges between one node per layer.

    On a closed course it ends where it began. Args: corridor, of the course; lattice, of it; nodes [S], index across in
    each layer; samples, points per edge, evenly by station.
    """
    layers = jnp.arange(nodes.shape[0])
    offset, slope = lattice.offset[layers, nodes], lattice.slope[layers, nodes]
    count = nodes.shape[0] if lattice.closed else nodes.shape[0] - 1
    shares = np.linspace(0.0, 1.0, samples, endpoint=False)
    spacing = lattice.spacing[:count, None]
    basis = jnp.asarray(quintic_basis(shares), offset.dtype)

    def read(k: int) -> Float[Array, "n"]:
        ends = (offset, jnp.roll(offset, -1), slope, jnp.roll(slope, -1))
        parts = [x[:count, None] * basis[k, None, :, c] * spacing ** (c // 2) for c, x in enumerate(ends)]
        return (functools.reduce(operator.add, parts) / spacing**k).ravel()

    station = lattice.station[:count, None] + spacing * jnp.asarray(shares, offset.dtype)[None, :]
    d = read(0)
    at = frenet.sample(
        corridor.position,
        corridor.heading,
        curvature=corridor.curvature,
        start=corridor.station[0],
        spacing=corridor.spacing,
        station=station.ravel(),
    )
    heading, curvature = shape.to_plane(at.heading, at.curvature, d, read(1), read(2))
    return Path(
        station=station.ravel(), offset=d, position=frenet.to_world(at, d), heading=heading, curvature=curvature
    )
