"""What the planner is given at one moment of a drive."""

from jax import Array
from jaxtyping import Float

from urbanjax.course import Course
from urbanjax.planning.prediction import PredictionParams, predict
from urbanjax.roadmap.corridor import Corridor, Progress, WindowParams, progress, window
from urbanjax.roadmap.locate import LocateParams, locate
from urbanjax.types import Objects, Prediction, VehicleState, pytree


@pytree
class Situation:
    """The road around the ego, its place there, and where everybody else will be."""

    window: Corridor
    progress: Progress
    prediction: Prediction


def look(
    course: Course,
    station: Float[Array, ""],
    ego: VehicleState,
    objects: Objects,
    around: WindowParams,
    matching: LocateParams,
    future: PredictionParams,
) -> Situation:
    """The situation that a plan is made in. Args: station [m] along the course, around which its window lies."""
    road = window(course.corridor, station, around)
    here = progress(road, ego.position, ego.heading)
    lanes = locate(course.graph, objects.position, objects.heading, params=matching)
    return Situation(road, here, predict(course.graph, objects, lanes, future))
