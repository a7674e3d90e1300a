"""Which map is looked at."""

from urbanjax.types import pytree, static


@pytree
class MapStudy:
    """Which map."""

    file: str = static(default="")  # CommonRoad XML, Lanelet2 OSM or SUMO net XML
