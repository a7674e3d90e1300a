"""When a way of localizing loses its place for good."""

import numpy as np


def lost_after(distance: np.ndarray, limit: float) -> int | None:
    """The scan from which on the error stays above `limit`; None if it does not at the end."""
    well = np.flatnonzero(distance <= limit)
    last = int(well[-1]) + 1 if len(well) else 0
    return last if last < len(distance) else None
