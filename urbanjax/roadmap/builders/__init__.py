"""Road networks from a few numbers, or from a list of lanes (host side; a RoadGraph comes out)."""

from urbanjax.roadmap.builders.district import district
from urbanjax.roadmap.builders.junctions import intersection
from urbanjax.roadmap.builders.lanes import assemble
from urbanjax.roadmap.builders.roads import curve, merge, straight, two_way
from urbanjax.roadmap.builders.roundabout import roundabout
from urbanjax.roadmap.builders.specs import LaneSpec, RoadStyle

__all__ = [
    "LaneSpec",
    "RoadStyle",
    "assemble",
    "curve",
    "district",
    "intersection",
    "merge",
    "roundabout",
    "straight",
    "two_way",
]
