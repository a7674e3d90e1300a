"""highway-env's environments with an ego that anybody can drive; imports highway-env, so import it late."""

from typing import Any

from highway_env.envs.common.abstract import AbstractEnv
from highway_env.envs.common.action import ContinuousAction
from highway_env.envs.exit_env import ExitEnv
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.controller import ControlledVehicle
from highway_env.vehicle.kinematics import Vehicle

from urbanjax.io.bridges.highway.network import continuations
from urbanjax.types import ConfigError

# Intersections change the class of all IDM vehicles for good: every reset begins with these.
IDM = {name: getattr(IDMVehicle, name) for name in ("DISTANCE_WANTED", "COMFORT_ACC_MAX", "COMFORT_ACC_MIN")}


class RoutedVehicle(Vehicle):
    """A vehicle driven by steering and acceleration that remembers where its environment sends it."""

    route: list[tuple[str, str, int | None]] | None = None  # roads to take, with the lane where it matters
    plan_route_to = ControlledVehicle.plan_route_to


class RoutedAction(ContinuousAction):
    """Steering and acceleration of a routed vehicle."""

    @property
    def vehicle_class(self) -> Any:
        """Of the ego that an environment makes."""
        return RoutedVehicle


class DrivenEnv(AbstractEnv):
    """What is changed of an environment: one ego, with a route where it has a goal, and no rewards.

    Rewards are left out because some are defined for discrete actions only; egos beyond the first become IDM vehicles.
    """

    def define_spaces(self) -> None:
        """Give the ego, which is made from its action, a place for its route."""
        super().define_spaces()
        self.action_type = RoutedAction(self, **self.config["action"])

    def _reset(self) -> None:
        for name, value in IDM.items():
            setattr(IDMVehicle, name, value)
        super()._reset()
        for other in self.controlled_vehicles[1:]:
            replace_with_idm(self.road, other, change_lanes=True)
        self.controlled_vehicles = self.controlled_vehicles[:1]
        if destination := self.config.get("destination"):
            self.vehicle.route = _route_to(self.vehicle, destination)
        elif isinstance(self, ExitEnv):  # it asks for lanes instead of planning a route
            lanes = self.config["lanes_count"]
            self.vehicle.route = [("0", "1", lanes - 1), ("1", "2", lanes), ("2", "exit", 0)]

    def _reward(self, action: Any) -> float:
        return 0.0

    def _rewards(self, action: Any) -> dict[str, float]:
        return {}


def replace_with_idm(road: Any, vehicle: Any, *, change_lanes: bool) -> IDMVehicle:
    """highway-env's IDM and MOBIL vehicle in the place, state and route of another.

    Args: road, highway-env's; vehicle, on that road; change_lanes, false for a vehicle that keeps to its lane.
    """
    route, place = getattr(vehicle, "route", None), road.vehicles.index(vehicle)
    idm = IDMVehicle(
        road,
        vehicle.position,
        vehicle.heading,
        vehicle.speed,
        route=None if route is None else list(route),
        enable_lane_change=change_lanes,
    )
    road.vehicles[place] = idm
    return idm


def _route_to(vehicle: Any, destination: str) -> list[tuple[str, str, int | None]]:
    """The roads from a vehicle to a node of its road network."""
    network, roads = vehicle.road.network, [vehicle.lane_index[:2]]
    for begin, end in roads:  # grows while it is read
        lanes = [(begin, end, i) for i in range(len(network.graph[begin][end]))]
        after = [target[:2] for lane in lanes for targets in continuations(network, lane) for target in targets]
        roads += [road for road in dict.fromkeys(after) if road not in roads]
    nodes = list(dict.fromkeys(end for _, end in roads))
    if destination not in nodes:
        raise ConfigError(
            f"'destination' {destination!r} is no node that the ego can drive to: use one of {', '.join(nodes)}"
        )
    return vehicle.plan_route_to(destination).route
