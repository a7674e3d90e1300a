"""What stands beside the road: buildings, walls, trees, poles and parked cars, all of them vertical prisms."""

import dataclasses

import numpy as np
from jax import Array

from urbanjax.types import pytree


@pytree
class Surroundings:
    """K vertical prisms over oriented rectangles."""

    centre: Array  # [K, 2] m, in the map frame
    heading: Array  # [K] rad, of the length
    half: Array  # [K, 2] m, half the length and half the width
    bottom: Array  # [K] m above the ground
    top: Array  # [K] m above the ground
    reflectivity: Array  # [K] share of the light that comes back, 0 to 1
    valid: Array  # [K] bool


def altered(surroundings: Surroundings, share: float, seed: int = 0) -> Surroundings:
    """The surroundings with that share of the prisms changed: a third each removed, moved and resized (host side).

    They move 2 to 8 m along their length, which follows the road, and only shrink in plan, so that they stay off it.
    """
    rng = np.random.default_rng(seed)
    rows = {field.name: np.array(getattr(surroundings, field.name)) for field in dataclasses.fields(surroundings)}
    standing = np.flatnonzero(rows["valid"])
    chosen = rng.permutation(standing)[: round(share * len(standing))]
    removed, moved, resized = np.array_split(chosen, 3)
    rows["valid"][removed] = False
    way = rng.uniform(2.0, 8.0, len(moved)) * rng.choice([-1, 1], len(moved))
    heading = rows["heading"][moved]
    rows["centre"][moved] += way[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    rows["half"][resized] *= rng.uniform(0.4, 0.8, (len(resized), 2))
    rows["top"][resized] = np.maximum(rows["bottom"][resized] + 0.3, rows["top"][resized] * rng.uniform(0.5, 1.5))
    return Surroundings(**rows)
