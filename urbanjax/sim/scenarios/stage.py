"""A road with a route on it, on which road users are put by where they are from the ego's route (host side)."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from urbanjax.roadmap.corridor import Corridor, CorridorParams, corridor_along
from urbanjax.roadmap.graph import RoadGraph, RoadType
from urbanjax.roadmap.padding import GraphSize, pad
from urbanjax.roadmap.route import RouteParams, route_between
from urbanjax.sim import lanes as tables
from urbanjax.sim.agents import Traffic, TrafficParams
from urbanjax.sim.lanes import LaneTables
from urbanjax.sim.replay import Replay
from urbanjax.sim.signals import SignalProgram, always_green
from urbanjax.sim.world import WorldState
from urbanjax.types import RoadUser, ScenarioError, VehicleState, as_arrays, host_record
from urbanjax.vehicle.params import VehicleParams

SAME_LANE = 1.8  # m aside, from which on somebody is in another lane
STILL = 1e-3  # m/s, below which what is written has no direction


@host_record
class StageSize:
    """The shapes that all stages of a bucket share, so that one compiled program serves them."""

    graph: GraphSize = GraphSize(n_links=48, n_successors=3, n_relations=9, n_signals_per_link=1)
    n_signals: int = 4
    n_ways: int = 9  # links that can be reached at once from one
    n_stations: int = 640  # of the corridor, a metre apart
    n_vehicles: int = 12
    n_recorded: int = 0  # road users that move as written
    n_times: int = 0  # records of those
    n_prisms: int = 512  # that stand beside the road, where it is looked at by a LiDAR


@host_record
class Stage:
    """Where a drive takes place, without its road users."""

    corridor: Corridor
    lanes: LaneTables
    size: StageSize

    @property
    def graph(self) -> RoadGraph:
        """The padded road graph."""
        return self.lanes.graph

    def place(self, station: float, lane: int = 0) -> tuple[int, float]:
        """Link and station on it [m] of a place on the route. Args: station m; lane, how many to the left of it.

        Raises ScenarioError where there is no such lane.
        """
        row, q = self._row(station), self.corridor.route_lane + lane
        if not 0 <= q < self.corridor.has_lane.shape[1] or not bool(self.corridor.has_lane[row, q]):
            raise ScenarioError(f"there is no lane {lane:+d} beside the route at {station:.0f} m")
        link = int(self.corridor.lane_link[row, q])
        return link, self.along(link, self.point(station, self.offset(station, lane))[0])

    def _row(self, station: float) -> int:
        return min(max(round(station / float(self.corridor.spacing)), 0), len(self.corridor.station) - 1)

    def offset(self, station: float, lane: int) -> float:
        """Offset [m] of a lane's centre from the route. Args: station m; lane, how many to the left of the route's."""
        return float(self.corridor.lane_offset[self._row(station), self.corridor.route_lane + lane])

    def point(self, station: float, offset: float = 0.0) -> tuple[np.ndarray, float]:
        """Position [2] m and heading rad of a place beside the route. Args: station m; offset m, left positive."""
        steps = station / float(self.corridor.spacing)
        row = min(max(int(np.floor(steps)), 0), len(self.corridor.station) - 2)
        share = steps - row
        position, heading = np.asarray(self.corridor.position), np.asarray(self.corridor.heading)
        at = position[row] + share * (position[row + 1] - position[row])
        angle = heading[row] + share * (heading[row + 1] - heading[row])
        return at + offset * np.array([-np.sin(angle), np.cos(angle)]), float(angle)

    def along(self, link: int, position: np.ndarray) -> float:
        """Station [m] of the point of a link that is nearest. Args: link; position [2] m."""
        line, station = np.asarray(self.graph.centre[link], float), np.asarray(self.graph.station[link], float)
        step = np.diff(line, axis=0)
        share = np.clip(((position - line[:-1]) * step).sum(1) / (step**2).sum(1), 0, 1)
        k = int(np.argmin(np.linalg.norm(line[:-1] + share[:, None] * step - position, axis=1)))
        return float(station[k] + share[k] * (station[k + 1] - station[k]))

    def on(self, link: int, station: float) -> np.ndarray:
        """The point [2] m of a link at a station. Args: link; station m along it."""
        line, stations = np.asarray(self.graph.centre[link], float), np.asarray(self.graph.station[link], float)
        return np.array([np.interp(station, stations, line[:, i]) for i in range(2)])

    def beyond_junctions(self) -> float:
        """Station [m] at which the last junction of the route ends."""
        link = np.asarray(self.corridor.lane_link[:, self.corridor.route_lane])
        inside = (np.asarray(self.graph.road_type)[link] == RoadType.JUNCTION) & np.asarray(self.corridor.valid)
        return float(self.corridor.station[np.flatnonzero(inside)[-1]])

    def choice(self, link: int) -> int:
        """Which of a link's successors the route takes. Args: link, on the route."""
        following = [int(x) for x in self.lanes.successor[link][: int(self.lanes.n_successors[link])]]
        driven = set(np.asarray(self.corridor.lane_link[:, self.corridor.route_lane]).tolist())
        return next((k for k, there in enumerate(following) if there in driven), 0)

    def lanes_at(self, station: float) -> list[int]:
        """The lanes in the route's direction there, as numbers to the left of it. Args: station m."""
        row = self._row(station)
        there = np.asarray(self.corridor.has_lane[row]) & ~np.asarray(self.corridor.oncoming[row])
        return [int(q) - self.corridor.route_lane for q in np.flatnonzero(there)]


def stage(graph: RoadGraph, start: int, *, goal: int, size: StageSize) -> Stage:
    """The stage along the cheapest route. Args: graph; start and goal, links; size, of all arrays."""
    graph = pad(graph, size.graph)
    zone: dict[str, Any] = {"area": jnp.zeros_like(graph.area), "area_names": ("",), "n_signals": size.n_signals}
    graph = graph.replace(**zone)
    found = route_between(graph, start, goal=goal, params=RouteParams(n_links=32))
    lanes = tables.from_graph(graph, n_ways=size.n_ways).replace(has_conflicts=True)
    params = as_arrays(CorridorParams(n_stations=size.n_stations))
    corridor, lanes = jax.device_get((_corridor(graph, found, params=params), lanes))
    return Stage(corridor, lanes, size)


_corridor = jax.jit(corridor_along)


class Cast:
    """Who is on a stage; filled by one call for each road user."""

    def __init__(self, stage: Stage, others: TrafficParams, *, vehicle: VehicleParams) -> None:
        """Nobody yet. Args: stage; others, how traffic drives; vehicle, the ego's dimensions."""
        self.stage, self.others, self.vehicle = stage, others, vehicle
        self.rows: list[dict[str, Any]] = []
        self.recorded: list[dict[str, Any]] = []
        self.ego: VehicleState | None = None
        self.ego_link = 0
        self.start = 0.0
        self.signals: SignalProgram | None = None
        self.written_period = 1.0

    def add_ego(self, station: float, *, speed: float, lane: int = 0) -> None:
        """The ego, its rear axle at a station of the route. Args: station m; speed m/s; lane, to the left of it."""
        self.start, (self.ego_link, _) = station, self.stage.place(station, lane)
        position, heading = self.stage.point(station, self.stage.offset(station, lane))
        state: dict[str, Any] = {"position": position, "heading": heading, "speed": speed}
        self.ego = VehicleState(**as_arrays({**state, "acceleration": 0.0, "steering": 0.0}))

    def add(self, station: float, *, speed: float, lane: int = 0, **fields: Any) -> None:
        """A vehicle, its box centre at a station of the route.

        Args: station m; speed m/s; lane, to the left of the route's; fields, of `Traffic`, for this one.
        """
        link, along = self.stage.place(station, lane)
        self.add_on(link, along, speed=speed, **fields)

    def add_on(self, link: int, station: float, *, speed: float, **fields: Any) -> None:
        """A vehicle on any link. Args: link; station m along it; speed m/s; fields, of `Traffic`, for this one."""
        if len(self.rows) >= self.stage.size.n_vehicles:
            raise ScenarioError(f"a stage of {self.stage.size.n_vehicles} vehicles is full")
        limit = float(self.stage.graph.speed_limit[link])
        self.rows.append({"link": link, "station": station, "speed": speed, "desired_speed": speed / limit, **fields})

    def add_standing(self, station: float, *, lane: int = 0, offset: float = 0.0, **fields: Any) -> None:
        """A vehicle that stands for good. Args: station m; lane, to the left of the route's; offset m; fields."""
        where: dict[str, Any] = {"offset": offset, "offset_from": offset, "offset_to": offset}
        self.add(station, speed=0.0, lane=lane, desired_speed=0.0, reacts=False, **where, **fields)

    def add_written(
        self, position: np.ndarray, *, period: float, kind: RoadUser, size: tuple[float, float] = (0.6, 0.6)
    ) -> None:
        """A road user that moves as written. Args: position [T, 2] m; period s; kind; size m, length and width."""
        step = np.gradient(position, period, axis=0)
        speed = np.linalg.norm(step, axis=1)
        moves = speed > STILL
        heading = np.arctan2(step[:, 1], step[:, 0])
        heading = np.where(moves, heading, heading[np.argmax(moves)] if moves.any() else 0.0)
        self.recorded.append(
            {"position": position, "heading": heading, "speed": speed, "size": size, "kind": int(kind)}
        )
        self.written_period = period

    @property
    def front(self) -> float:
        """Station [m] of the ego's front bumper."""
        return self.start + float(self.vehicle.length) - float(self.vehicle.rear_overhang)

    @property
    def half(self) -> float:
        """Half the length [m] of a default vehicle."""
        return float(self.others.vehicle_length) / 2

    def free(self, station: float, lane: int, *, gap: float) -> bool:
        """Whether nobody stands within a distance. Args: station m; lane, to the left of the route's; gap m."""
        position, heading = self.stage.point(station, self.stage.offset(station, lane))
        frame = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
        away = [np.abs((self.stage.on(row["link"], row["station"]) - position) @ frame) for row in self.rows]
        return all(along >= gap or across >= SAME_LANE for along, across in away)

    def world(self) -> WorldState:
        """The world at time 0."""
        assert self.ego is not None
        return jax.tree.map(
            np.asarray,
            WorldState(
                ego=self.ego,
                ego_link=jnp.asarray(self.ego_link, jnp.int32),
                traffic=self._traffic(),
                signals=self._signals(),
                time=jnp.zeros(()),
                count=jnp.asarray(0, jnp.int32),
                replay=self._replay(),
                ego_route=jnp.asarray(self.stage.choice(self.ego_link), jnp.int32),
            ),
        )

    def _traffic(self) -> Traffic:
        n, p = self.stage.size.n_vehicles, self.others
        default: dict[str, Any] = {
            **dict.fromkeys(("offset", "acceleration", "offset_from", "offset_to", "cooldown", "other_station"), 0.0),
            **{"moved": 1.0, "has_other": False, "route": 0, "changes": False, "reacts": True, "valid": True},
            **{"length": float(p.vehicle_length), "width": float(p.vehicle_width)},
            **{"headway": float(p.idm.time_headway), "politeness": float(p.politeness)},
        }
        nobody = {"link": 0, "station": 0.0, "speed": 0.0, "desired_speed": 1.0, "other": 0, "valid": False}
        rows = [{**default, "other": row["link"], **row} for row in self.rows]
        rows += [{**default, **nobody}] * (n - len(rows))
        names = [spec.name for spec in dataclasses.fields(Traffic)]
        columns: dict[str, Any] = {name: np.array([row[name] for row in rows]) for name in names}
        kinds = {name: x.astype(np.float32 if x.dtype == float else np.int32) for name, x in columns.items()}
        return Traffic(**{name: x if columns[name].dtype != bool else columns[name] for name, x in kinds.items()})

    def _signals(self) -> SignalProgram:
        if self.signals is not None:
            return self.signals
        return always_green(self.stage.size.n_signals)

    def _replay(self) -> Replay | None:
        size = self.stage.size
        if not size.n_recorded:
            return None
        times = size.n_times
        position, rows = np.zeros((times, size.n_recorded, 2)), np.zeros((2, times, size.n_recorded))
        dimensions, kind = np.ones((2, size.n_recorded)), np.zeros(size.n_recorded, np.int32)
        valid = np.zeros((times, size.n_recorded), bool)
        for v, who in enumerate(self.recorded):
            position[:, v], rows[0, :, v], rows[1, :, v] = who["position"], who["heading"], who["speed"]
            dimensions[:, v], kind[v], valid[:, v] = who["size"], who["kind"], True
        floats: dict[str, Any] = {"position": position, "heading": rows[0], "speed": rows[1]}
        floats["period"] = self.written_period
        floats |= {"length": dimensions[0], "width": dimensions[1]}
        return Replay(**as_arrays(floats), **as_arrays({"valid": valid, "kind": kind}))
