"""The localizers by name: two functions each, chosen when the program is traced."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import jaxlie
from jax import lax

from urbanjax.course import Course
from urbanjax.localization import given, lidar, motion, relocalize
from urbanjax.localization.lidar import LidarLocalizerParams, LidarState
from urbanjax.localization.relocalize import RelocalizeParams
from urbanjax.localization.types import Health, Localization
from urbanjax.registration.voxelmap import VoxelMap
from urbanjax.types import Observation, ScenarioError


class Localizer(NamedTuple):
    """Three functions.

    `init(params, course, T_map_body) -> state`, `step(params, course, state, observation) -> localization, state` and
    `recover(params, search, course, state, observation) -> state`, with the pose found anew where it was lost.
    """

    init: Callable[[LidarLocalizerParams, Course, jaxlie.SE2], Any]
    step: Callable[[LidarLocalizerParams, Course, Any, Observation], tuple[Localization, Any]]
    recover: Callable[[LidarLocalizerParams, RelocalizeParams, Course, Any, Observation], Any]


def _map_of(course: Course) -> VoxelMap:
    if course.map is None:
        raise ScenarioError("localizer 'lidar' needs course.map; build one with urbanjax.localization.mapping")
    return course.map


def _lidar_step(
    params: LidarLocalizerParams, course: Course, state: Any, observation: Observation
) -> tuple[Localization, Any]:
    return lidar.step(params, _map_of(course), course.graph, state, observation)


def _lidar_recover(
    params: LidarLocalizerParams, search: RelocalizeParams, course: Course, state: LidarState, observation: Observation
) -> LidarState:
    world = _map_of(course)

    def find() -> LidarState:
        starts = relocalize.lane_starts(course.graph, state.T_map_body, count=search.starts)
        found, moved = relocalize.relocalize(
            search, params, world=world, state=state, observation=observation, starts=starts
        )
        # The step to come, on the same observation, moves the pose on by one period.
        back = motion.travelled(observation.odometry, params.period).inverse()
        before = jax.tree.map(lambda a, b: jnp.where(found.found, a, b), moved.T_map_body @ back, moved.T_map_body)
        return moved.replace(T_map_body=before)

    health = state.monitor.health
    return lax.cond((health == Health.LANE) | (health == Health.RELOCALIZE), find, lambda: state)


LOCALIZERS = {
    "given": Localizer(
        lambda *_: None,
        lambda params, course, state, observation: (given.step(observation), None),
        lambda params, search, course, state, observation: state,
    ),
    "lidar": Localizer(lambda params, course, T_map_body: lidar.init(params, T_map_body), _lidar_step, _lidar_recover),
}
