"""Random boxes and plain NumPy geometry, written from the definitions."""

import jax.numpy as jnp
import numpy as np

from urbanjax.types import Objects

FIELDS = ("position", "heading", "speed", "length", "width", "valid")


def objects(position, heading, speed, length=4.0, width=2.0, valid=True, dtype=None):
    """Objects with every field of the shape of `heading`, in `dtype` (default: the current default)."""
    heading = np.asarray(heading, float)
    dtype = jnp.zeros(()).dtype if dtype is None else dtype
    given = (heading, speed, length, width)
    heading, speed, length, width = (jnp.asarray(np.broadcast_to(x, heading.shape), dtype) for x in given)
    position = jnp.asarray(np.broadcast_to(position, (*heading.shape, 2)), dtype)
    return Objects(position, heading, speed, length, width, jnp.asarray(np.broadcast_to(valid, heading.shape)))


def random_objects(rng, shape, spread=40.0, dtype=None):
    return objects(
        rng.uniform(-spread, spread, (*shape, 2)),
        rng.uniform(-np.pi, np.pi, shape),
        rng.uniform(0, 20, shape),
        rng.uniform(2, 8, shape),
        rng.uniform(1, 3, shape),
        dtype=dtype,
    )


def pick(tree, *index):
    """One element, or a part, of every field."""
    return Objects(*(getattr(tree, name)[index] for name in FIELDS))


def drive(start, count, dt):
    """Tracks [T, ..] of objects that keep their velocity."""
    time = np.arange(count) * dt
    way = np.stack([np.cos(start.heading), np.sin(start.heading)], -1) * np.asarray(start.speed)[..., None]
    moved = np.asarray(start.position) + time.reshape(-1, *(1,) * way.ndim) * way
    rest = (np.broadcast_to(getattr(start, name), (count, *start.heading.shape)) for name in FIELDS[1:])
    return objects(moved, *rest, dtype=start.heading.dtype)


def polygon(position, heading, length, width):
    """Corners [.., 4, 2], counter-clockwise."""
    heading = np.asarray(heading, float)
    along = np.stack([np.cos(heading), np.sin(heading)], -1) * np.asarray(length, float)[..., None] / 2
    across = np.stack([-np.sin(heading), np.cos(heading)], -1) * np.asarray(width, float)[..., None] / 2
    return (
        np.stack([along + across, across - along, -along - across, along - across], -2)
        + np.asarray(position)[..., None, :]
    )


def meet(a, b):
    """Whether convex polygons [.., 4, 2] share a point: an edge crosses, or one holds the other's corner.

    Nothing of separating axes is in here.
    """

    def cross(u, v):
        return u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]

    def holds(outer, inner):
        edge = np.roll(outer, -1, -2) - outer
        side = cross(edge[..., None, :, :], inner[..., :, None, :] - outer[..., None, :, :])
        return (side >= 0).all(-1).any(-1)

    p, r = a[..., :, None, :], (np.roll(a, -1, -2) - a)[..., :, None, :]
    q, s = b[..., None, :, :], (np.roll(b, -1, -2) - b)[..., None, :, :]
    denominator = cross(r, s)
    with np.errstate(divide="ignore", invalid="ignore"):
        t, u = cross(q - p, s) / denominator, cross(q - p, r) / denominator
    crossing = (denominator != 0) & (t >= 0) & (t <= 1) & (u >= 0) & (u <= 1)
    return crossing.any((-1, -2)) | holds(a, b) | holds(b, a)


def outline(tree):
    return polygon(*(np.asarray(getattr(tree, name), float) for name in ("position", "heading", "length", "width")))
