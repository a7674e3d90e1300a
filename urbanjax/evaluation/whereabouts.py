"""How well a driver knew where it was that had to find its pose from scans."""

from collections.abc import Sequence

import numpy as np
from jax import Array

from urbanjax.localization.types import Health, Localization
from urbanjax.numerics import safe
from urbanjax.types import VehicleState, pytree

WRONG = 0.5  # m, an error that must not go unnoticed


@pytree
class Whereabouts:
    """T steps of a drive."""

    error: Array  # [T] m, in the plane, of the pose that it drove on
    health: Array  # [T] int32, a Health

    @staticmethod
    def of(found: Localization, truth: VehicleState) -> "Whereabouts":
        """What was known, beside the truth. Args: found [T]; truth [T], the ego."""
        away = found.pose.translation() - truth.position
        return Whereabouts(safe.norm(away), found.health)


def columns(believed: Sequence[Whereabouts], *, duration: float, period: float) -> dict[str, float]:
    """What the row of a drive says of it, nothing of one whose poses were given (host side).

    Args: believed, parts of the drive one after the other; duration [s], until the drive ended; period [s] of a step.
    """
    if not believed:
        return {}
    steps = round(duration / period)
    error, health = (np.concatenate([getattr(part, name) for part in believed])[:steps] for name in ("error", "health"))
    error = error.astype(float)
    normal = health == Health.NORMAL
    return {
        "localization_mean_error_m": float(error.mean()),
        "localization_largest_error_m": float(error.max()),
        "localization_not_normal_s": period * float((~normal).sum()),
        "localization_unnoticed_s": period * float((normal & (error > WRONG)).sum()),
        "localization_stopped_s": period * float((health == Health.STOP).sum()),
    }
