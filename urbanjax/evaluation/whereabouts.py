"""How well a driver knew where it was that had to find its pose from scans."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jax import Array

from urbanjax.localization.types import Health, Localization
from urbanjax.numerics import safe
from urbanjax.types import VehicleState, pytree

LONG = 1.0  # s, for which nobody may be wrong without knowing
WRONG = 0.5  # m, an error that must not go unnoticed


@pytree
class Whereabouts:
    """T steps of a drive."""

    error: Array  # [T] m, in the plane, of the pose that it drove on
    health: Array  # [T] int32, a Health
    dropped: Array  # [T] int32, voxels of scan and map that found no place

    @staticmethod
    def of(found: Localization, truth: VehicleState) -> "Whereabouts":
        """What was known, beside the truth. Args: found [T], its info the voxels dropped [T, 2]; truth [T], the ego."""
        away = found.pose.translation() - truth.position
        return Whereabouts(safe.norm(away), found.health, jnp.sum(found.info, axis=1))


def longest_unnoticed(error: np.ndarray, health: np.ndarray) -> int:
    """The most steps in a row with a wrong pose that is called NORMAL. Args: error [T] m; health [T], each a Health."""
    silent = (error > WRONG) & (health == Health.NORMAL)
    ends = np.flatnonzero(np.diff(np.concatenate([[False], silent, [False]]).astype(int)))
    return int((ends[1::2] - ends[::2]).max(initial=0))


def columns(believed: Sequence[Whereabouts], *, duration: float, period: float) -> dict[str, float]:
    """What the row of a drive says of it, nothing of one whose poses were given (host side).

    Args: believed, parts of the drive one after the other; duration [s], until the drive ended; period [s] of a step.
    """
    if not believed:
        return {}
    steps = round(duration / period) + 1
    error, health, dropped = (
        np.concatenate([getattr(part, name) for part in believed])[:steps] for name in ("error", "health", "dropped")
    )
    error = error.astype(float)
    normal = health == Health.NORMAL
    return {
        "localization_mean_error_m": float(error.mean()),
        "localization_largest_error_m": float(error.max()),
        "localization_not_normal_s": period * float((~normal).sum()),
        "localization_longest_unnoticed_s": period * longest_unnoticed(error, health),
        "localization_stopped_s": period * float((health == Health.STOP).sum()),
        "localization_most_dropped": int(dropped.max()),
    }
