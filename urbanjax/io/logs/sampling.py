"""How the positions of a log were sampled: on which grid, which of them in truth, and how noisily."""

import numpy as np

from urbanjax.io.logs.record import VehicleLog

STEPS = tuple(
    sorted((a * 10.0**k * foot for k in range(-4, 3) for a in (1, 2, 5) for foot in (1.0, 0.3048)), reverse=True)
)
ON_GRID = 1e-4  # of a step: coordinates so near to its multiples lie on them
AT_LEAST = 0.15  # share of samples on a grid that is one
CLEAR = 1.5  # times the share that lies on a grid by chance; twice that share is what a true grid has
ENOUGH = 10_000  # samples that show a grid
FEWEST = 0.02  # share of samples in line with their neighbours below which it is chance
ROUNDING = 1e-9  # of coordinates, and m: offsets from a line that are none
MOVES = 1e-6  # m between two samples: less is no way that a third could lie on
INSTANT = 1e-9  # s: two samples nearer in time are at one
MOST = 0.98  # share of samples above which a pattern tells nothing


def resolution(position: np.ndarray) -> float:
    """Step of the coarsest grid (1-2-5 steps of m or feet) that a part of positions [n, 2] lies on; 0 for none, m.

    Of the points of a finer grid some lie on a coarser one by chance: more must do so, in x and in y.
    Args: position [n, 2] m.
    """
    if len(position) > ENOUGH:
        position = position[np.random.default_rng(0).choice(len(position), ENOUGH, replace=False)]
    steps = np.array(STEPS)
    cells = position / steps[:, None, None]
    near = np.abs(cells - np.round(cells)) <= ON_GRID  # [steps, n, 2]
    share, both = near.mean(1), near.all(-1).mean(1)
    flat = np.ptp(position, axis=0) <= 10 * steps[:, None]  # a coordinate that says nothing about such a step
    for k, step in enumerate(steps):
        chance = CLEAR * (share * steps[:, None] / step)[k + 1 :].max(0, initial=0.0)
        if both[k] >= AT_LEAST and np.all((share[k] >= chance) | flat[k]) and not flat[k].all():
            return float(step)
    return 0.0


def _on_grid(position: np.ndarray, step: float) -> np.ndarray:
    cells = position / step
    return np.all(np.abs(cells - np.round(cells)) <= ON_GRID, axis=-1)


def raw(log: VehicleLog) -> np.ndarray:
    """Which samples [n] were measured rather than interpolated between others.

    Where a good part of the positions lies on a grid, those that do; else those that are not exactly in line, in
    space and time, with the samples beside them. All, where neither pattern sets some samples apart.
    Args: log, as read.
    """
    step = resolution(log.position)
    if step > 0.0:
        on = _on_grid(log.position, step)
        return on if on.mean() < MOST else np.ones(log.n, bool)
    off = in_line(log)
    return ~off if FEWEST < off.mean() < MOST else np.ones(log.n, bool)


def in_line(log: VehicleLog) -> np.ndarray:
    """Which samples [n] lie where a straight and even movement between their neighbours passes at their time.

    Args: log, as read.
    """
    flag = np.zeros(log.n, bool)
    if log.n < 3:
        return flag
    share = (log.time[1:-1] - log.time[:-2]) / np.maximum(log.time[2:] - log.time[:-2], 1e-12)  # s, never 0
    between = log.position[:-2] + share[:, None] * (log.position[2:] - log.position[:-2])
    off = np.abs(log.position[1:-1] - between).max(1)
    size = ROUNDING * np.abs(log.position).max() + ROUNDING
    flag[1:-1] = (off <= size) & (np.abs(log.position[2:] - log.position[:-2]).max(1) > MOVES)
    return flag


def roughness(log: VehicleLog) -> float:
    """Median distance, m, of samples from the cubic in time through the two before and the two after; NaN below five.

    It holds the noise of times and positions alike, scaled so that white noise of any rate gives its own size.
    Args: log, as read.
    """
    if log.n < 5:
        return float("nan")
    n = log.n - 4
    t, p = (np.stack([a[k : n + k] for k in (0, 1, 3, 4)], 1) for a in (log.time, log.position))
    now, here = log.time[2:-2, None], log.position[2:-2]
    weight = np.ones((n, 4))
    for j in range(4):
        for k in range(4):
            if k != j:
                gap = t[:, j] - t[:, k]
                weight[:, j] *= (now[:, 0] - t[:, k]) / np.where(np.abs(gap) > INSTANT, gap, np.inf)
    off = np.linalg.norm(here - np.einsum("nj,njd->nd", weight, p), axis=-1)
    return float(np.median(off / np.sqrt(1 + (weight**2).sum(1))))
