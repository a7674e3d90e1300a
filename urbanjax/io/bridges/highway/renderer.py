"""highway-env as a renderer of our own rollouts: the road is built once, states are written, nothing is stepped."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from urbanjax.io.bridges.highway.environment import FREQUENCY
from urbanjax.io.bridges.highway.network import FLIP
from urbanjax.roadmap.graph import RoadGraph

EGO = (50, 200, 0)
OTHER = (100, 200, 255)
COLLIDED = (255, 100, 100)
STRAIGHT = 1e-4  # 1/m, greatest curvature of a lane that is drawn as a straight one
LEFT_OF_IT = 0.1  # m, offset from which an oncoming lane lies beside this one rather than on it


class Renderer:
    """Pictures of vehicles on a road graph, seen from above."""

    def __init__(self, graph: RoadGraph, width: int = 720, height: int = 120, scaling: float = 5.5):
        """Build the road. Args: width, height of the pictures in px; scaling in px per m."""
        from highway_env.envs.common.graphics import EnvViewer
        from highway_env.road.road import Road

        config = {
            "screen_width": width,
            "screen_height": height,
            "scaling": scaling,
            "centering_position": [0.3, 0.5],  # of the picture: more of the road ahead than behind
            "offscreen_rendering": True,
            "render_agent": True,
            "simulation_frequency": FREQUENCY,
            "show_trajectories": False,
            "real_time_rendering": False,
        }
        self.road = Road(network=_network(graph))
        self._env = SimpleNamespace(
            road=self.road, config=config, vehicle=None, action_type=None, observation_type=None
        )
        self._viewer = EnvViewer(self._env)

    def picture(
        self,
        position: np.ndarray,
        heading: np.ndarray,
        size: np.ndarray,
        collided: bool = False,
        camera: np.ndarray | None = None,
    ) -> np.ndarray:
        """An RGB picture [height, width, 3] of box centres [V, 2] m, headings [V] rad and sizes [V, 2] m.

        The first vehicle is the ego; the picture follows it, or `camera` [2] m where that is given.
        """
        from highway_env.vehicle.kinematics import Vehicle

        vehicles = []
        for i, (place, angle, (length, width)) in enumerate(zip(position, heading, size, strict=True)):
            vehicle = Vehicle(None, np.asarray(place, float) * FLIP, -float(angle), 0.0)
            vehicle.LENGTH, vehicle.WIDTH = float(length), float(width)
            vehicle.color = (COLLIDED if collided else EGO) if i == 0 else OTHER
            vehicles.append(vehicle)
        self.road.vehicles = vehicles
        centre = np.asarray(position[0] if camera is None else camera, float) * FLIP
        self._viewer.observer_vehicle = SimpleNamespace(position=centre)
        self._viewer.display()
        return self._viewer.get_image()


def _network(graph: RoadGraph) -> Any:
    """The links as highway-env lanes of constant width; a line is continuous where no change is permitted."""
    from highway_env.road.lane import LineType, PolyLaneFixedWidth, StraightLane
    from highway_env.road.road import RoadNetwork

    network = RoadNetwork()
    centre, left, right = (np.asarray(line, float) * FLIP for line in (graph.centre, graph.left, graph.right))
    width = np.linalg.norm(left - right, axis=-1).mean(-1)
    opposite, has_opposite = np.asarray(graph.opposite), np.asarray(graph.has_opposite)
    straight = np.abs(np.asarray(graph.curvature)).max(-1) < STRAIGHT
    for i in np.flatnonzero(np.asarray(graph.valid)):
        facing = opposite[i][has_opposite[i] & (np.asarray(graph.opposite_offset)[i] > LEFT_OF_IT)]
        drawn = not bool(graph.has_left[i]) and (facing < i).any()  # the oncoming lane has drawn the line between
        lines = (
            LineType.NONE if drawn else LineType.STRIPED if bool(graph.left_change[i]) else LineType.CONTINUOUS_LINE,
            LineType.NONE if bool(graph.has_right[i]) else LineType.CONTINUOUS_LINE,
        )
        if straight[i]:
            lane = StraightLane(centre[i, 0], centre[i, -1], width=float(width[i]), line_types=lines)
        else:
            lane = PolyLaneFixedWidth([tuple(point) for point in centre[i]], width=float(width[i]), line_types=lines)
        network.add_lane(f"{i}", f"{i}'", lane)
    return network
