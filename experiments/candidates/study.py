"""How fast candidate trajectories are made, rated and chosen, beside Frenetix on the same grids where it is installed.

Both do the same work: a grid of durations, end speeds and offsets over 3 s at 0.1 s, three costs, four limits. What is
timed on our side ends with the chosen trajectory and the costs and limits of all; the row "handed back" returns every
trajectory too, as Frenetix keeps them.
"""

import functools
import os
from collections.abc import Callable
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from experiments.candidates import peer
from experiments.common import timing
from urbanjax.numerics.soft import Relaxation
from urbanjax.planning.frenet_sampling import choice
from urbanjax.planning.frenet_sampling.choice import FrenetParams, FrenetPlan, FrenetWeights
from urbanjax.planning.frenet_sampling.fan import generate
from urbanjax.planning.frenet_sampling.limits import FrenetLimits
from urbanjax.planning.frenet_sampling.line import ReferenceLine, reference_line
from urbanjax.planning.frenet_sampling.motion import EndGrid, FrenetState
from urbanjax.types import SEED, ConfigError, Unread, as_arrays, pytree, static
from urbanjax.vehicle.driving import Driving
from urbanjax.vehicle.params import VehicleParams

HORIZON, PERIOD, SPACING, LENGTH = 3.0, 0.1, 0.5, 160.0  # s, s, m, m
Tick = Callable[[str], None]

DYNAMICS = ("max_acceleration", "max_deceleration", "max_steering_rate", "max_speed")
BODY = tuple(f"vehicle.{name}" for name in ("length", "width", "rear_overhang", *DYNAMICS))


@pytree
class CandidateStudy:
    """Sizes of the grids, each as the numbers of durations, end speeds and offsets; and what the candidates pay."""

    UNREAD: ClassVar[dict[str, Unread | None]] = {
        **dict.fromkeys(
            BODY, Unread("of the vehicle only wheelbase and max_steering matter to 'limits'; nobody is around")
        ),
    }

    vehicle: VehicleParams = VehicleParams(wheelbase=2.7)
    weights: FrenetWeights = FrenetWeights(longitudinal_jerk=0.0)
    limits: FrenetLimits = FrenetLimits()
    desired_speed: float = 10.0  # m/s
    few: tuple[int, ...] = static(default=(5, 8, 20))
    many: tuple[int, ...] = static(default=(10, 25, 40))
    sweep: tuple[int, ...] = static(default=(2, 5, 80))  # further numbers of offsets, with the rest of `few`
    scenarios: int = static(default=64)  # of the batch, each with the candidates of `few`
    at_once: int = static(default=0)  # how many scenarios run together; 0: one on a CPU, all elsewhere
    repeats: int = static(default=20)  # blocks of five of each call, taken in turns
    batch_repeats: int = static(default=3)
    seed: int = static(default=0, metadata=SEED)


def grid(shape: tuple[int, ...]) -> EndGrid:
    """So many durations (multiples of the period up to 3 s), speeds (4 to 14 m/s) and offsets (-3 to 3 m)."""
    if len(shape) != 3:
        raise ConfigError(f"'few' and 'many' are numbers of durations, speeds and offsets, not {list(shape)}")
    n, v, d = shape
    if not 1 <= n <= 20 or min(v, d) < 1:
        raise ConfigError(
            f"candidates: {n} durations, {v} speeds, {d} offsets: use 1 to 20 durations, 1 or more others"
        )
    step = np.round(2 / n, 1)
    durations = np.round(HORIZON - step * np.arange(n)[::-1], 1)
    points = round(HORIZON / PERIOD) + 1
    return EndGrid(np.linspace(-3, 3, d), np.linspace(4, 14, v), (0.0,), durations, PERIOD, points, heading="slope")


def params_of(study: CandidateStudy, ends: EndGrid) -> FrenetParams:
    """The same terms as Frenetix: norms over samples without their period, jerk over the first 0.1 s."""
    weights, root = study.weights, np.sqrt(PERIOD)
    weights = weights.replace(speed=weights.speed / root, offset=weights.offset / root)
    return as_arrays(FrenetParams(ends, weights, study.limits, jerk_time=peer.JERK_TIME))


@pytree
class Road:
    """A made-up winding road, and where the vehicle is on it."""

    line: ReferenceLine
    path: np.ndarray  # [M, 2] m, the same line for the peer, 0.1 m apart
    state: FrenetState


def road(rng: np.random.Generator | None = None, speed: float = 9.0) -> Road:
    """A road with curves of 60 to 120 m radius; without a generator always the same."""
    sway, length, phase, jitter = (0.3, 30.0, 0.0, np.zeros(6)) if rng is None else _drawn(rng)
    fine = np.arange(0, LENGTH + 0.005, 0.01)
    heading = sway * (np.cos(phase) - np.cos(fine / length + phase))
    step = np.stack([np.cos(heading), np.sin(heading)], 1)
    position = np.concatenate([np.zeros((1, 2)), np.cumsum((step[1:] + step[:-1]) / 2 * 0.01, axis=0)])
    rows = slice(None, None, round(SPACING / 0.01))
    curvature = sway / length * np.sin(fine[rows] / length + phase)
    points, angle, bend = (jnp.asarray(v, float) for v in (position[rows], heading[rows], curvature))
    start, spacing = as_arrays((0.0, SPACING))
    line = reference_line(points, angle, curvature=bend, start=start, spacing=spacing)
    begin = jnp.asarray(np.array([20.0, speed, 0.3, 0.4, 0.2, 0.05]) + jitter, float)
    return Road(line, position[::10], FrenetState(begin[:3], begin[3:]))


def _drawn(rng: np.random.Generator) -> tuple[float, float, float, np.ndarray]:
    sway, length, phase = rng.uniform([0.2, 25, 0], [0.35, 35, 2 * np.pi])
    return sway, length, phase, rng.uniform(-1, 1, 6) * [5, 3, 0.3, 0.6, 0.2, 0]


def measure(study: CandidateStudy, tick: Tick = lambda label: None) -> dict[str, float]:
    """Agreement with the peer (if there), then medians in milliseconds: name with unit to value."""
    tick("candidates: agreement")
    here, out = road(), {"candidates_threads": float(len(os.sched_getaffinity(0)))}
    if peer.library() is not None:
        for name, shape in (("few", study.few), ("many", study.many)):
            found = peer.agreement(here, grid(shape), params_of(study, grid(shape)), study)
            out.update({f"agreement_{name}_{key}": value for key, value in found.items()})
        slow = grid(study.few).replace(lateral="station", speeds=np.linspace(0.5, 4, study.few[1]))
        found = peer.agreement(road(speed=1.5), slow, params_of(study, slow), study)
        out.update({f"agreement_slow_{key}": value for key, value in found.items()})
    shapes = [(*study.few[:2], n) for n in study.sweep] + [study.few, study.many]
    for shape in sorted(set(shapes), key=np.prod):
        tick(f"candidates: {np.prod(shape)}")
        out.update(_time_one(study, here, shape))
    tick(f"candidates: {study.scenarios} scenarios")
    return out | _time_batch(study)


def driving_of(study: CandidateStudy, params: FrenetParams) -> Driving:
    """The study's vehicle, planning with `params`, in mode hard."""
    return as_arrays(Driving(study.vehicle, params, Relaxation(), PERIOD))


def _whole(line: ReferenceLine, state: FrenetState, *, driving: Driving, **scene: Any) -> tuple[FrenetPlan, jax.Array]:
    """The plan and every trajectory."""
    chosen = choice.plan(line, state, driving=driving, **scene)
    return chosen, generate(line, state, grid=driving.params.grid).values


def _time_one(study: CandidateStudy, here: Road, shape: tuple[int, ...]) -> dict[str, float]:
    count, driving = int(np.prod(shape)), driving_of(study, params_of(study, grid(shape)))
    rest = {"desired_speed": jnp.asarray(study.desired_speed, float), "prediction": None, "driving": driving}
    out: dict[str, float] = {}
    calls: dict[str, Callable[[], Any]] = {}
    for suffix, function in (("", choice.plan), ("_handed_back", _whole)):
        program = functools.partial(jax.jit(function), here.line, here.state, **rest)
        out[f"candidates_{count}{suffix}_first_call_s"] = timing.seconds(program)
        calls[f"candidates_{count}{suffix}_ms"] = program
    return out | _beside(study, calls, str(count), [here], grid(shape), study.repeats)


def _time_batch(study: CandidateStudy) -> dict[str, float]:
    rng = np.random.default_rng(study.seed)
    roads = [road(rng) for _ in range(study.scenarios)]
    lines, states = jax.tree.map(lambda *x: jnp.stack(x), *((r.line, r.state) for r in roads))
    wishes = jnp.full(study.scenarios, study.desired_speed)
    driving, name = driving_of(study, params_of(study, grid(study.few))), f"{study.scenarios}x{np.prod(study.few)}"
    at_once = study.at_once or (1 if jax.default_backend() == "cpu" else study.scenarios)
    program = jax.jit(choice.plans, static_argnames="at_once")
    calls: dict[str, Callable[[], Any]] = {
        f"candidates_{name}_ms": lambda: program(
            lines, states, desired_speeds=wishes, predictions=None, driving=driving, at_once=at_once
        )
    }
    out = {f"candidates_{name}_first_call_s": timing.seconds(calls[f"candidates_{name}_ms"])}
    return out | _beside(study, calls, name, roads, grid(study.few), study.batch_repeats)


def _beside(
    study: CandidateStudy, calls: dict[str, Callable[[], Any]], name: str, roads: list[Road], ends: EndGrid, runs: int
) -> dict[str, float]:
    """Milliseconds of our calls and of the peer's two modes, and how many times faster than its better one we are."""
    theirs: list[str] = []
    if peer.library() is not None:
        frenetix = peer.Frenetix(study, roads, ends)
        calls[f"frenetix_{name}_serial_ms"] = lambda: frenetix.run(concurrent=False)
        calls[f"frenetix_{name}_concurrent_ms"] = lambda: frenetix.run(concurrent=True)
        theirs = list(calls)[-2:]
    out = {key: 1e3 * seconds for key, seconds in timing.medians(calls, runs).items()}
    for ours in [key for key in out if theirs and key not in theirs]:
        out[ours.replace("_ms", "_times_faster")] = min(out[key] for key in theirs) / out[ours]
    return out


def agreement_table(numbers: dict[str, float]) -> dict[str, list[Any]]:
    """Largest differences from Frenetix by heading for people; a column for each grid."""
    scenes = {"few": "{:.0f} candidates", "many": "{:.0f} candidates", "slow": "{:.0f} at low speed"}
    names = [key.removeprefix("agreement_few_") for key in numbers if key.startswith("agreement_few_")]
    columns: dict[str, list[Any]] = {"largest difference": names[1:]}
    for scene, title in scenes.items():
        heading = title.format(numbers.get(f"agreement_{scene}_candidates", 0))
        columns[heading] = [numbers.get(f"agreement_{scene}_{name}") for name in names[1:]]
    return columns


def times_table(numbers: dict[str, float]) -> dict[str, list[Any]]:
    """Times by heading for people: of Frenetix the better mode; "all out" hands every trajectory back.

    The time to compile is that of the first call.
    """
    ends = "_first_call_s", "_handed_back_first_call_s"
    sizes = [k.removeprefix("candidates_").removesuffix(ends[0]) for k in numbers if k.endswith(ends[0])]
    sizes = [size for size in sizes if not size.endswith("_handed_back")]

    def of(key: str) -> list[Any]:
        return [numbers.get(key.format(size)) for size in sizes]

    modes = zip(of("frenetix_{}_serial_ms"), of("frenetix_{}_concurrent_ms"), strict=True)
    return {
        "candidates": [size.replace("x", " scenarios x ") for size in sizes],
        "ours [ms]": of("candidates_{}_ms"),
        "Frenetix [ms]": [None if mode[0] is None else min(mode) for mode in modes],
        "faster": of("candidates_{}_times_faster"),
        "all out [ms]": of("candidates_{}_handed_back_ms"),
        "faster, all out": of("candidates_{}_handed_back_times_faster"),
        "compile [s]": of("candidates_{}_first_call_s"),
    }
