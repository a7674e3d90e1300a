"""Readers of road maps: each file becomes a `RoadMap`, whose graph the rest of the house drives on."""

from urbanjax.evaluation.recorded.planning_problem import Goal, PlanningProblem, Region
from urbanjax.io.maps.reading import DanglingWarning, read
from urbanjax.io.maps.road import MapFault, MapLane, RoadMap
from urbanjax.io.maps.scene import Scene, scene
from urbanjax.io.maps.xml import MapError
from urbanjax.sim.recording import Recording
from urbanjax.sim.signals import SignalCycle

__all__ = [
    "DanglingWarning",
    "Goal",
    "MapError",
    "MapFault",
    "MapLane",
    "PlanningProblem",
    "Recording",
    "Region",
    "RoadMap",
    "Scene",
    "SignalCycle",
    "read",
    "scene",
]
