"""What a mission is driven on: the map and the route through it."""

from urbanjax.roadmap.extended import ExtendedGraph
from urbanjax.roadmap.graph import RoadGraph
from urbanjax.types import pytree


@pytree
class Course:
    """The road graph with the extended graph along one route; constant while the route holds."""

    graph: RoadGraph
    extended: ExtendedGraph
