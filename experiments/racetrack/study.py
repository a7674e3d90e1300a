"""The lattice of a racetrack and the cheapest lap through it, beside Dijkstra on the very same edges."""

import functools
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from experiments.common.timing import median, timed
from urbanjax.course import Course, course_between
from urbanjax.io.maps import racetrack
from urbanjax.io.maps.racetrack import Racetrack
from urbanjax.numerics.soft import Relaxation
from urbanjax.planning.lattice import course_lattice
from urbanjax.planning.lattice.course_lattice import CourseLattice, CourseLatticeParams
from urbanjax.planning.lattice.course_path import driven
from urbanjax.planning.lattice.search import closed_search, layered_search
from urbanjax.roadmap.corridor import CorridorParams
from urbanjax.types import POSITIVE, SEED, ScenarioError, Unread, as_arrays, field, pytree, static
from urbanjax.vehicle.params import VehicleParams

BARRED = 1e6  # m, cost of an edge that is not there

COUNTED = ("lattice.n_layers", "lattice.nodes_per_lane", "lattice.closed")
DYNAMICS = ("max_acceleration", "max_deceleration", "max_steering_rate", "max_speed")
BODY = tuple(f"vehicle.{name}" for name in ("length", "rear_overhang", *DYNAMICS))


@pytree
class RacetrackStudy:
    """Which track, what lattice and what the cheapest lap minimises."""

    UNREAD: ClassVar[dict[str, Unread | None]] = {
        **dict.fromkeys(COUNTED, Unread("the course and the spacings of 'lattice' say it")),
        "lattice.*_scale": Unread("the lattice is built with hard limits"),
        **dict.fromkeys(BODY, Unread("of the vehicle only width, wheelbase and max_steering decide where it fits")),
    }

    lattice: CourseLatticeParams = CourseLatticeParams(straight_spacing=16.0)
    vehicle: VehicleParams = VehicleParams()
    bending: float = 2000.0  # m of way that 1/m of integral of squared curvature is worth; 0: the shortest lap
    temperature: float = field(default=1.0, metadata=POSITIVE)  # m of cost, of the soft twin
    file: str = static(default="", metadata={"path": True})  # a racetrack's CSV; without one, a track made up here
    seed: int = static(default=0, metadata=SEED)  # of the direction in which the soft value is differentiated
    runs: int = static(default=20, metadata={"range": (1, 1000)})  # per timing


class Lap(NamedTuple):
    """The lattice of a course and the cheapest way round, in double precision."""

    course: Course
    lattice: CourseLattice  # as built, in the default precision
    cost: np.ndarray  # [e, M, M] m, BARRED where there is no edge
    hard: tuple[Any, ...]  # value, node and edge weights
    soft: tuple[Any, ...]
    numbers: dict[str, float]


def made_up(radius: float = 120.0, n: int = 300) -> Racetrack:
    """A circuit of bends to both sides, whose width varies."""
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    reach = radius * (1 + 0.22 * np.cos(2 * angle) + 0.16 * np.sin(3 * angle))
    position = reach[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    width = 5.0 + 1.2 * np.sin(5 * angle)
    return Racetrack(position, width, width[::-1].copy(), np.arange(1, n + 1), closed=True)


def course_of(study: RacetrackStudy) -> Course:
    """The track once round. Raises MapError where the file is no track."""
    found = racetrack.read(study.file) if study.file else racetrack.road_map(Path("made-up track"), made_up())
    return course_between(found.graph, 0, goal=len(found.ids) - 1, corridor=CorridorParams(lanes=1))


def solve(study: RacetrackStudy) -> Lap:
    """The cheapest lap, hard and soft, the same by Dijkstra, and how long each took.

    On a track that is no circuit, the cheapest way from its first to its last layer. Raises ScenarioError where the
    lattice holds none: it names what to change.
    """
    course = course_of(study)
    params = as_arrays(course_lattice.sized(course.corridor, study.lattice))
    vehicle, relaxation = as_arrays(study.vehicle), as_arrays(Relaxation())
    build = functools.partial(_build, course.corridor, vehicle, params=params, relaxation=relaxation)
    first, lattice = timed(build)
    numbers = {
        "course_m": float(course.corridor.length),
        "layers": lattice.station.shape[0],
        "nodes": float(jnp.sum(lattice.node > 0.5)),
        "edges": float(jnp.sum(lattice.edge > 0.5)),
        "build_first_s": first,
        "build_median_ms": 1e3 * median(build, runs=study.runs),
    }
    with jax.enable_x64(True):
        steps = slice(None) if lattice.closed else slice(0, -1)
        edge, length, bending = (np.asarray(x, float)[steps] for x in (lattice.edge, lattice.length, lattice.bending))
        cost = np.where(edge > 0.5, length + float(study.bending) * bending, BARRED)
        search = functools.partial(_search, jnp.asarray(cost), lattice.closed)
        hard, soft = (search(as_arrays(Relaxation(study.temperature, mode=mode))) for mode in ("hard", "soft"))
        if not float(hard[0]) < BARRED:
            raise ScenarioError(
                f"no path leads through the lattice of {study.file or 'the track'}: lower its lateral_spacing, or "
                "raise max_curvature or max_slope"
            )
        numbers["search_median_ms"] = 1e3 * median(search, as_arrays(Relaxation()), runs=study.runs)
        numbers |= _checks(study, cost, lattice.closed, hard, soft)
    path = np.asarray(hard[2]) > 0.5
    greatest = np.asarray(lattice.greatest)[steps]
    numbers |= {
        "lap_length_m": float(length[path].sum()),
        "lap_greatest_curvature_1pm": float(greatest[path].max()),
        "lap_bending_1pm": float(bending[path].sum()),
        "middle_bending_1pm": float(np.trapezoid(*_middle(course))),
    }
    return Lap(course, lattice, cost, tuple(map(np.asarray, hard)), tuple(map(np.asarray, soft)), numbers)


def path_table(lap: Lap) -> dict[str, np.ndarray]:
    """The cheapest lap point by point, for the table on disk."""
    path = driven(lap.course.corridor, lap.lattice, nodes=jnp.asarray(lap.hard[1].argmax(1)), samples=8)
    origin = np.array(lap.course.graph.origin)
    position = np.asarray(path.position) + origin
    return {
        "station_m": np.asarray(path.station),
        "x_m": position[:, 0],
        "y_m": position[:, 1],
        "heading_rad": np.asarray(path.heading),
        "curvature_1pm": np.asarray(path.curvature),
        "offset_m": np.asarray(path.offset),
    }


def dijkstra(cost: np.ndarray, closed: bool) -> float:
    """The cost of the cheapest way by scipy's Dijkstra: round a circuit back to the same node, or from end to end."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra as shortest

    count, size = cost.shape[:2]
    step, row, column = np.nonzero(cost < BARRED)
    places = (step * size + row, (step + 1) * size + column)
    graph = csr_array((cost[step, row, column], places), shape=((count + 1) * size,) * 2)
    found = np.asarray(shortest(graph, indices=np.arange(size)))[:, count * size :]
    return float(np.diagonal(found).min() if closed else found.min())


def log_paths(cost: np.ndarray, closed: bool) -> float:
    """Logarithm of the number of paths."""
    ways, total = np.eye(cost.shape[1]), 0.0
    for step in cost:
        ways = ways @ (step < BARRED)
        total, ways = total + np.log(ways.max()), ways / ways.max()
    return float(total + np.log(np.trace(ways) if closed else ways.sum()))


def _checks(study: RacetrackStudy, cost: np.ndarray, closed: bool, hard: Any, soft: Any) -> dict[str, float]:
    """The search against Dijkstra, the soft value against its bounds, its slope against the edge marginals."""
    seconds, oracle = timed(dijkstra, cost, closed)
    relaxation = as_arrays(Relaxation(study.temperature, mode="soft"))
    step = 1e-5
    direction = np.random.default_rng(study.seed).normal(size=cost.shape) * (cost < BARRED)
    ends = [float(_search(jnp.asarray(cost + sign * step * direction), closed, relaxation)[0]) for sign in (1, -1)]
    return {
        "cost_m": float(hard[0]),
        "dijkstra_cost_m": oracle,
        "dijkstra_difference_m": abs(float(hard[0]) - oracle),
        "dijkstra_s": seconds,
        "soft_cost_m": float(soft[0]),
        "soft_least_m": float(hard[0]) - float(study.temperature) * log_paths(cost, closed),
        "soft_slope_difference": abs((ends[0] - ends[1]) / (2 * step) - float(np.sum(np.asarray(soft[2]) * direction))),
    }


def _middle(course: Course) -> tuple[np.ndarray, np.ndarray]:
    """Squared curvature and station of the reference line."""
    there = np.asarray(course.corridor.valid)
    return np.asarray(course.corridor.curvature)[there] ** 2, np.asarray(course.corridor.station)[there]


def _search(cost: Any, closed: bool, relaxation: Relaxation) -> tuple[Any, ...]:
    return _closed(cost, relaxation) if closed else _open(jnp.zeros_like(cost[0, 0]), cost, relaxation=relaxation)


_build = jax.jit(course_lattice.build)
_closed, _open = jax.jit(closed_search), jax.jit(layered_search)
