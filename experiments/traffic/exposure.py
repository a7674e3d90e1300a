"""Safety of rollouts, team by team: what the ego vehicle exposes itself and others to."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from experiments.common.overtaking import Fig10
from urbanjax.traffic.safety.measure import SafetyParams, Summary, measure
from urbanjax.types import Objects, as_arrays

NAMES = {
    "min_ttc": "least TTC [s]",
    "min_headway": "least headway [s]",
    "max_deceleration": "greatest DRAC [m/s^2]",
    "tet": "TET [s]",
    "tit": "TIT [s^2]",
    "min_box_ttc": "least TTC of boxes [s]",
    "min_pet": "least PET [s]",
    "rss_share": "RSS violated [%]",
}


def exposures(rollouts: Fig10, params: SafetyParams) -> Summary:
    """What each ego vehicle met, [A, S]."""
    dt = float(rollouts.time[1] - rollouts.time[0])

    def one(ego: jax.Array, speed: jax.Array, others: jax.Array, moving: jax.Array, present: jax.Array) -> Summary:
        size = jnp.broadcast_to(jnp.asarray([rollouts.vehicle.length, rollouts.vehicle.width]), (*speed.shape, 2))
        boxes = jnp.concatenate([jnp.concatenate([ego, size], axis=-1)[:, None], others], axis=1)
        tracks = Objects(
            position=boxes[..., :2],
            heading=boxes[..., 2],
            speed=jnp.concatenate([speed[:, None], moving], axis=1),
            length=boxes[..., 3],
            width=boxes[..., 4],
            valid=jnp.broadcast_to(jnp.concatenate([jnp.ones(1, bool), present])[None], boxes.shape[:2]),
        )
        return jax.tree.map(lambda v: v[0], measure(tracks, dt, params=as_arrays(params)).summary)

    velocity = np.gradient(rollouts.others[:, 0, :, :, :, :2], dt, axis=2)
    moving = np.hypot(velocity[..., 0], velocity[..., 1])
    a, s = rollouts.speed.shape[0], rollouts.speed.shape[2]
    present = np.broadcast_to(rollouts.present, (a, *rollouts.present.shape))
    arrays = rollouts.ego[:, 0], rollouts.speed[:, 0], rollouts.others[:, 0], moving, present
    flat = tuple(jnp.asarray(v.reshape(a * s, *v.shape[2:])) for v in arrays)
    found = jax.jit(lambda *each: jax.lax.map(lambda one_of: one(*one_of), each))(*flat)
    return jax.tree.map(lambda v: np.asarray(v).reshape(a, s), found)


def exposure_table(rollouts: Fig10, found: Summary) -> dict[str, list[Any]]:
    """One row per tau: medians over the starts, the share of time in per cent."""
    rows: dict[str, list[Any]] = {"tau": rollouts.taus.tolist()}
    for name, heading in NAMES.items():
        values = np.median(getattr(found, name), axis=1) * (100 if name == "rss_share" else 1)
        rows[heading] = [float(v) if np.isfinite(v) else None for v in values]
    return rows
