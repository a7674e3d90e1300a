"""The localizers by name: two functions each, chosen when the program is traced."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jaxlie

from urbanjax.course import Course
from urbanjax.localization import given, lidar
from urbanjax.localization.lidar import LidarLocalizerParams
from urbanjax.localization.types import Localization
from urbanjax.types import Observation, ScenarioError


class Localizer(NamedTuple):
    """Two functions.

    `init(params, course, T_map_body) -> state` and `step(params, course, state, observation) -> localization, state`.
    """

    init: Callable[[LidarLocalizerParams, Course, jaxlie.SE2], Any]
    step: Callable[[LidarLocalizerParams, Course, Any, Observation], tuple[Localization, Any]]


def _lidar_step(
    params: LidarLocalizerParams, course: Course, state: Any, observation: Observation
) -> tuple[Localization, Any]:
    if course.map is None:
        raise ScenarioError("localizer 'lidar' needs course.map; build one with urbanjax.localization.mapping")
    return lidar.step(params, course.map, course.graph, state, observation)


LOCALIZERS = {
    "given": Localizer(lambda *_: None, lambda params, course, state, observation: (given.step(observation), None)),
    "lidar": Localizer(lambda params, course, T_map_body: lidar.init(params, T_map_body), _lidar_step),
}
