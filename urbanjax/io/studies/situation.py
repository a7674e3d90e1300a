"""What the planner is given at one moment of a drive."""

from jax import Array
from jaxtyping import Float

from urbanjax.planning.prediction import predict
from urbanjax.roadmap.course import Course
from urbanjax.roadmap.extended import ExtendedGraph, Progress, progress, window
from urbanjax.roadmap.locate import locate
from urbanjax.stack import StackParams
from urbanjax.types import Objects, Prediction, VehicleState, pytree


@pytree
class Situation:
    """The road around the ego, its place there, and where everybody else will be."""

    window: ExtendedGraph
    progress: Progress
    prediction: Prediction


def look(
    params: StackParams, course: Course, station: Float[Array, ""], ego: VehicleState, objects: Objects
) -> Situation:
    """The situation that a plan is made in. Args: station [m] along the course, around which its window lies."""
    road = window(course.extended, station, params.window)
    here = progress(road, ego.position, ego.heading)
    lanes = locate(course.graph, objects.position, objects.heading, params=params.locate)
    return Situation(road, here, predict(course.graph, objects, lanes, params.planning.prediction))
