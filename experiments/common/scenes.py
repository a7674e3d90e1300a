"""What drives depend on each other: those on one road or in one recording."""

from typing import Any

import numpy as np

from urbanjax.evaluation.missions import MISSIONS
from urbanjax.evaluation.missions.mission import ROADS


def scenes(rows: list[dict[str, Any]]) -> np.ndarray:
    """The road or the recording of each drive: drives of one depend on each other."""
    named = [(base(row), row) for row in rows]
    return np.array([f"{name} {row['seed'] % ROADS if name in MISSIONS else ''}" for name, row in named])


def base(row: dict[str, Any]) -> str:
    """The mission of a drive, however it knew where it was."""
    return row["mission"].removesuffix(f"_{row['localization']}")
