"""The figures of the candidate study."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from experiments.candidates.study import CandidateStudy, driving_of, grid, params_of, road
from urbanjax.io.figures.style import GOOD, LINE, OTHER, ROAD, figure
from urbanjax.planning.frenet_sampling import choice
from urbanjax.planning.frenet_sampling.fan import generate

HALF_WIDTH = 5.25  # m, of the road that is drawn


def draw_fan(study: CandidateStudy, path: Path) -> None:
    """The candidates of the smaller grid over the road, coloured by cost, and the chosen one."""
    from matplotlib.collections import LineCollection

    here, ends = road(), grid(study.few)
    params = params_of(study, ends.replace(heading="exact"))
    wish, driving = jnp.asarray(study.desired_speed, float), driving_of(study, params)
    plan = jax.jit(choice.plan)(here.line, here.state, desired_speed=wish, prediction=None, driving=driving)
    fan = jax.jit(generate)(here.line, here.state, grid=params.grid)
    points = np.moveaxis(np.asarray(fan.position), 0, -1).reshape(plan.cost.size, -1, 2)
    broken = np.asarray(plan.reasons).any(axis=0).ravel()
    cost = np.asarray(plan.terms).sum(axis=0).ravel()
    order = np.argsort(-cost)
    with figure(path, 10.0, height=4.2) as canvas:
        axes = canvas.subplots()
        _road(axes, here.path)
        axes.add_collection(LineCollection([*points[broken]], colors=OTHER, linewidths=0.4, alpha=0.35))
        kept = LineCollection([*points[[i for i in order if not broken[i]]]], cmap="viridis_r", linewidths=0.7)
        kept.set_array(np.array([cost[i] for i in order if not broken[i]]))
        axes.add_collection(kept)
        axes.plot(*np.asarray(plan.values)[:2], color="black", lw=2.2, label="chosen")
        axes.plot(*points[int(plan.chosen), 0], "o", color="black", ms=5)
        axes.plot([], color=OTHER, lw=0.8, label=f"breaks a limit ({broken.sum()} of {broken.size})")
        canvas.colorbar(kept, ax=axes, label="cost [-]", shrink=0.8)
        low, high = points.reshape(-1, 2).min(axis=0), points.reshape(-1, 2).max(axis=0)
        axes.set(xlim=(low[0] - 2, high[0] + 2), ylim=(low[1] - 2, high[1] + 2), aspect="equal")
        axes.set(title=f"{cost.size} candidates over 3 s", xlabel="x [m]", ylabel="y [m]")
        axes.legend(loc="upper left")


def _road(axes: object, path: np.ndarray) -> None:
    along = np.gradient(path, axis=0)
    left = np.stack([-along[:, 1], along[:, 0]], 1) / np.hypot(*along.T)[:, None]
    edges = np.concatenate([path + HALF_WIDTH * left, (path - HALF_WIDTH * left)[::-1]])
    axes.fill(*edges.T, color=ROAD, zorder=0)
    axes.plot(*path.T, color=LINE, lw=1.0, ls=(0, (6, 6)), zorder=0.5)


def draw_times(numbers: dict[str, float], path: Path) -> None:
    """Milliseconds against the number of candidates, of both."""
    lines = (
        ("candidates_{}_ms", GOOD, "o-", "urbanjax: costs, limits and the chosen one"),
        ("candidates_{}_handed_back_ms", GOOD, "s--", "urbanjax: every trajectory handed back"),
        ("frenetix_{}_serial_ms", OTHER, "^--", "Frenetix 0.4.0, serial"),
        ("frenetix_{}_concurrent_ms", OTHER, "v-", "Frenetix 0.4.0, concurrent"),
    )
    pattern = "candidates_", "_handed_back_ms"
    sizes = sorted(int(k[len(pattern[0]) : -len(pattern[1])]) for k in numbers if k.endswith(pattern[1]))
    with figure(path, 6.4, height=4.0) as canvas:
        axes = canvas.subplots()
        for key, colour, style, label in lines:
            if all(key.format(n) in numbers for n in sizes):
                axes.loglog(sizes, [numbers[key.format(n)] for n in sizes], style, color=colour, ms=4, label=label)
        for n in sizes:
            faster = numbers.get(f"candidates_{n}_times_faster")
            if faster is not None:
                between = numbers[f"candidates_{n}_ms"] * faster**0.5
                axes.text(n, between, f"{faster:.0f} times", ha="center", va="center", fontsize=8)
        threads = numbers["candidates_threads"]
        axes.set(title=f"Warm medians on {threads:.0f} threads", xlabel="candidates", ylabel="time [ms]")
        axes.legend()
