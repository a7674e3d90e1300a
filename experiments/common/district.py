"""The stated world: a furnished district, a point-cloud map of it from a drive of its own, and a drive to localize."""

from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from urbanjax.course import Course, course_between
from urbanjax.evaluation.survey import MappingParams, survey
from urbanjax.io.clouds import pointmap
from urbanjax.localization import mapping
from urbanjax.localization.lidar import LidarLocalizerParams
from urbanjax.roadmap.builders import district
from urbanjax.sim.lidar import LidarParams
from urbanjax.sim.scenarios import tour
from urbanjax.sim.scenarios.tour import Tour, TourParams
from urbanjax.sim.scenery.scenery import Scenery, furnish
from urbanjax.types import (
    SEED,
    ConfigError,
    field,
    host_record,
    pytree,
    static,
)

FIRST = 1  # the link on which the drives begin
LEAST = 10  # scans of a drive


@host_record
class World:
    """What the localizer is given, and the truth that it does not know."""

    course: Course  # with the map
    surroundings: Scenery
    points: mapping.PointMap
    tour: Tour


@pytree
class WorldParams:
    """The district and both drives."""

    drive: TourParams = TourParams()
    sensor: LidarParams = LidarParams()
    mapping: MappingParams = MappingParams()
    # m of the course that are mapped and driven, 0 for all of it
    stretch: float = field(default=0.0, metadata={"range": (0.0, 1e5)})
    seed: int = static(default=0, metadata=SEED)


def build(
    params: WorldParams, localizer: LidarLocalizerParams, tick: Callable[[str], None], file: str | Path = ""
) -> World:
    """The world of a seed. Args: file, a map made before; without one the district is mapped, a minute on two cores."""
    graph = district()
    last = int(graph.predecessor[FIRST, 0])
    course = course_between(graph, FIRST, goal=last)
    surroundings = jax.tree.map(jnp.asarray, furnish(graph, params.seed))
    key = jax.random.key(params.seed)
    if file:
        points = pointmap.load(file)
    else:
        tick("mapping the district")
        mapped = course.corridor
        if params.stretch:
            mapped = mapped.replace(length=jnp.minimum(mapped.length, params.stretch + params.mapping.reach))
        scans = survey(
            params.mapping,
            mapped,
            surroundings=surroundings,
            sensor=params.sensor,
            localizer=localizer,
            key=jax.random.fold_in(key, 1),
        )
        points = mapping.build(((cloud, pose) for cloud, _, pose in scans), float(params.mapping.resolution))
    world = mapping.distributions(points, params.mapping.distributions)
    truth = tour.drive(jax.random.fold_in(key, 2), course.corridor, params=params.drive)
    if params.stretch:
        steps = int(np.searchsorted(np.asarray(truth.station), float(params.stretch)))
        if steps < LEAST:
            raise ConfigError(f"'world.stretch' of {float(params.stretch):g} m holds {steps} scans; {LEAST} are needed")
        truth = jax.tree.map(lambda x: x[:steps], truth)
    return World(course.replace(map=world), surroundings, points, truth)
