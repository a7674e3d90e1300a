"""The figure of the drives in highway-env."""

from pathlib import Path
from typing import Any

import numpy as np

from experiments.highway.study import IDM, STACK
from urbanjax.io.figures.style import BAD, GOOD, LINE, figure


def draw(rows: dict[str, list[Any]], path: Path) -> None:
    """Mean speed of each drive: ours against the IDM vehicle's in the same traffic; collisions are crosses."""
    envs = list(dict.fromkeys(rows["env"]))
    with figure(path, 2.6 * len(envs), height=3.0) as canvas:
        for axis, env in zip(np.atleast_1d(canvas.subplots(1, len(envs))), envs, strict=True):
            pairs = _pairs(rows, env)
            if not pairs:
                continue
            low = min(min(x, y) for x, y, _ in pairs) - 1.0
            high = max(max(x, y) for x, y, _ in pairs) + 1.0
            axis.plot([low, high], [low, high], color=LINE, lw=1.0)
            for x, y, crashed in pairs:
                axis.plot(x, y, "x" if crashed else "o", color=BAD if crashed else GOOD, ms=5, alpha=0.8)
            axis.set(title=env, xlabel="IDM [m/s]", xlim=(low, high), ylim=(low, high), aspect="equal")
        canvas.axes[0].set_ylabel("our stack [m/s]")


def _pairs(rows: dict[str, list[Any]], env: str) -> list[tuple[float, float, bool]]:
    """Mean speeds of IDM and stack in the same traffic, and whether the stack collided."""
    found: dict[int, dict[str, tuple[float, bool]]] = {}
    for name, who, seed, speed, crashed in zip(
        *(rows[key] for key in ("env", "driver", "seed", "mean_speed_mps", "collision")), strict=True
    ):
        if name == env:
            found.setdefault(seed, {})[who] = speed, crashed
    return [(pair[IDM][0], *pair[STACK]) for pair in found.values() if len(pair) == 2]
