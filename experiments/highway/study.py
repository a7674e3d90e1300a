"""Our stack in highway-env beside highway-env's own IDM vehicle: what the drives amount to."""

from collections.abc import Iterator, Sequence
from typing import Any, ClassVar

import numpy as np

from urbanjax.evaluation import statistics
from urbanjax.io.bridges.highway.driver import HIGHWAY_STACK, DriverParams, StackDriver
from urbanjax.io.bridges.highway.environment import FREQUENCY, check_drivable, open_environment
from urbanjax.io.bridges.highway.episode import Episode, Idm, drive
from urbanjax.io.bridges.highway.measure import time_to_collision
from urbanjax.stack import StackParams
from urbanjax.types import POSITIVE, SEED, Unread, pytree, static

STACK, IDM = "stack", "IDM"
OURS = ("stack", "driver", "gif_every")  # what only drives of our stack depend on


@pytree
class HighwayStudy:
    """Which environments, how often and for how long."""

    UNREAD: ClassVar[dict[str, Unread | None]] = {
        **dict.fromkeys(OURS, Unread("our stack does not drive, see 'drivers'", lambda p: STACK not in p.drivers)),
    }

    stack: StackParams = HIGHWAY_STACK
    driver: DriverParams = DriverParams()
    envs: tuple[str, ...] = static(default=("highway-v0", "merge-v1", "two-way-v0", "racetrack-v1"))
    drivers: tuple[str, ...] = static(default=(STACK, IDM), metadata={"choices": (STACK, IDM)})
    seeds: int = static(default=20)  # drives per environment and driver
    seed: int = static(default=0, metadata=SEED)  # the first one
    destination: str = static(default="")  # node of the road to drive to; none: where the environment sends its ego
    duration: float = static(default=40.0, metadata=POSITIVE)  # s, or the end of the road
    gif_every: int = static(default=5, metadata={"range": (0, 1000)})  # steps between pictures; 0: none


def drives(study: HighwayStudy, tick: Any = lambda label, share: None) -> Iterator[Episode]:
    """The drives of the study, one by one. Args: tick, told a label and the share of all drives that is done."""
    ours = StackDriver(study.stack, study.driver)
    total, done = len(study.envs) * len(study.drivers) * study.seeds, 0
    steps = round(study.duration * FREQUENCY)
    for name in study.envs:
        check_drivable(name)
    config = {"destination": study.destination} if study.destination else {}
    for name in study.envs:
        # On the racetrack the baseline only follows its lane; elsewhere it changes lanes where that is faster.
        baseline = Idm(change_lanes=not name.startswith("racetrack"))
        env = open_environment(name, duration=study.duration, **config)
        for who in study.drivers:
            for seed in range(study.seed, study.seed + study.seeds):
                label = f"{name}, {who}, seed {seed}"
                every = study.gif_every if who == STACK and seed == study.seed else 0
                yield drive(
                    env,
                    (name, who),
                    driver=ours if who == STACK else baseline,
                    seed=seed,
                    duration=study.duration,
                    frame_every=every,
                    tick=lambda step, at=done, text=label: tick(text, (at + step / steps) / total),
                )
                done += 1
        env.close()


def scores(episodes: Sequence[Episode], duration: float) -> dict[str, list[Any]]:
    """One row per drive, for the table on disk."""
    steps = round(duration * FREQUENCY) + 1
    return {
        "env": [e.env for e in episodes],
        "driver": [e.driver for e in episodes],
        "seed": [e.seed for e in episodes],
        "collision": [e.collision for e in episodes],
        "off_road": [not bool(e.on_road.all()) for e in episodes],
        "arrived": [e.arrived for e in episodes],
        "distance_m": [e.distance for e in episodes],
        "nominal_s": [e.nominal for e in episodes],
        "driven_s": [float(e.time[-1]) for e in episodes],
        "mean_speed_mps": [e.mean_speed for e in episodes],
        "least_ttc_s": [float(time_to_collision(e, steps).min()) for e in episodes],
        "step_median_ms": [1e3 * float(np.median(e.step_seconds)) if e.step_seconds else None for e in episodes],
    }


def table(rows: dict[str, list[Any]]) -> dict[str, list[Any]]:
    """Columns by heading, one row per environment and driver."""
    out: dict[str, list[Any]] = {}
    for env, who, chosen in _groups(rows):
        step = [t for t in chosen["step_median_ms"] if t is not None]
        arrived = [a for a in chosen["arrived"] if a is not None]
        for heading, value in {
            "environment": env,
            "driver": who,
            "drives": len(chosen["seed"]),
            "collisions": sum(chosen["collision"]),
            "collisions [%]": statistics.rate(chosen["collision"]).percent.text(),
            "off the road": sum(chosen["off_road"]),
            "arrived": sum(arrived) if arrived else None,
            "mean speed [m/s]": statistics.mean(chosen["mean_speed_mps"]).text(2),
            "least TTC [s]": min(chosen["least_ttc_s"]),
            "median TTC [s]": float(np.median(chosen["least_ttc_s"])),
            "step [ms]": float(np.median(step)) if step else None,
        }.items():
            out.setdefault(heading, []).append(value)
    return out


def summary(rows: dict[str, list[Any]]) -> dict[str, Any]:
    """Flat numbers of the study: means and rates with their intervals, and how much faster the stack is, in pairs."""
    out: dict[str, Any] = {}
    speeds: dict[str, dict[str, dict[int, float]]] = {}
    for env, who, chosen in _groups(rows):
        name = f"{env}_{who.lower()}"
        out[f"{name}_drives"] = len(chosen["seed"])
        for what, column in {"collisions": "collision", "off_road": "off_road", "arrived": "arrived"}.items():
            happened = [value for value in chosen[column] if value is not None]
            if happened:
                out[f"{name}_{what}"] = sum(happened)
                out |= statistics.rate(happened).flat(f"{name}_{what}_share")
        out |= statistics.mean(chosen["mean_speed_mps"]).flat(f"{name}_mean_speed_mps")
        out[f"{name}_least_ttc_s"] = min(chosen["least_ttc_s"])
        step = [t for t in chosen["step_median_ms"] if t is not None]
        if step:
            out[f"{name}_step_median_ms"] = float(np.median(step))
        speeds.setdefault(env, {})[who] = dict(zip(chosen["seed"], chosen["mean_speed_mps"], strict=True))
    for env, found in speeds.items():
        both = sorted(set(found.get(STACK, {})) & set(found.get(IDM, {})))
        if both:
            faster = [found[STACK][seed] - found[IDM][seed] for seed in both]
            out |= statistics.mean(faster).flat(f"{env}_faster_than_idm_mps")
    return out


def tracks(episodes: Sequence[Episode]) -> dict[str, Any]:
    """One row per sample of every drive."""
    count = [len(e.time) for e in episodes]

    def repeated(name: str) -> np.ndarray:
        return np.repeat([getattr(e, name) for e in episodes], count)

    def joined(name: str) -> np.ndarray:
        return np.concatenate([getattr(e, name) for e in episodes])

    position = joined("position")
    return {
        **{name: repeated(name) for name in ("env", "driver", "seed")},
        "time_s": joined("time"),
        "x_m": position[:, 0],
        "y_m": position[:, 1],
        "heading_rad": joined("heading"),
        "speed_mps": joined("speed"),
        "on_road": joined("on_road"),
    }


def _groups(rows: dict[str, list[Any]]) -> Iterator[tuple[str, str, dict[str, list[Any]]]]:
    keys = list(zip(rows["env"], rows["driver"], strict=True))
    for key in dict.fromkeys(keys):
        yield *key, {name: [v for k, v in zip(keys, values, strict=True) if k == key] for name, values in rows.items()}
