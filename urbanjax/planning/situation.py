"""What a step sees: the road around the ego, everybody on it, and where they will be."""

import jax
from jax import Array

from urbanjax.course import Course
from urbanjax.planning.prediction import PredictionParams, Ways, predict
from urbanjax.roadmap.corridor import Corridor, WindowParams, window
from urbanjax.roadmap.locate import LocateParams, locate
from urbanjax.roadmap.progress import Progress, progress
from urbanjax.types import Objects, Observation, Prediction, Signals, VehicleState, pytree


@pytree
class SituationParams:
    """How far a step looks along its route, and how it takes others to go on."""

    window: WindowParams = WindowParams()
    locate: LocateParams = LocateParams()
    prediction: PredictionParams = PredictionParams()


@pytree
class Situation:
    """Everything that planning and behaviour know of the world in one step."""

    window: Corridor  # the lanes around the vehicle
    progress: Progress  # of the ego's rear axle along them
    ego: VehicleState
    objects: Objects
    prediction: Prediction
    signals: Signals
    ways: Ways | None = None  # where others are going to drive


def look(
    params: SituationParams, course: Course, *, station: Array, ego: VehicleState, observation: Observation
) -> Situation:
    """The situation of one step (Eq. 12, 25-26).

    Args: course, of the drive; station [] m, where the ego was last along its route; ego, its state; observation, of
    which objects and signals are used.
    """
    objects = observation.objects
    with jax.named_scope("route"):
        road = window(course.corridor, station, params=params.window)
        here = progress(road, ego.position, heading=ego.heading)
    with jax.named_scope("prediction"):
        lanes = locate(course.graph, objects.position, heading=objects.heading, params=params.locate)
        signals = observation.signals
        future, ways = predict(course.graph, objects, locations=lanes, signals=signals, params=params.prediction)
    return Situation(road, here, ego, objects, future, signals, ways)
