"""What happened in a drive, step by step: all that scores and verdicts are made of. Hard; batches go through vmap."""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float, Int

from urbanjax.evaluation.aim import arrived
from urbanjax.evaluation.case import Case
from urbanjax.evaluation.metrics import tracks
from urbanjax.geometry.boxes import box, overlap
from urbanjax.roadmap.corridor import Corridor
from urbanjax.roadmap.graph import RoadType
from urbanjax.roadmap.progress import Progress, progress, sample
from urbanjax.sim import signals
from urbanjax.sim.log import Log
from urbanjax.types import Objects, SignalState, pytree
from urbanjax.vehicle.params import VehicleParams

ROUNDING = 1e-3  # s, by which sums of periods may be off
INSIDE = 1.0  # m from the edge of the road, where nobody knows where that is: up to here from the ends of the map


@pytree
class Facts:
    """A drive of T steps among V others. It ends when the goal is reached or the time is up: see `alive`."""

    time: Array  # [T] s since the start
    alive: Array  # [T] bool, the drive is still on
    station: Array  # [T] m along the route, of the box centre
    offset: Array  # [T] m from the route's reference line, left positive
    heading_error: Array  # [T] rad, against the reference line
    along: Array  # [T] m/s, speed in the direction of the lane that the box centre lies in
    speed_limit: Array  # [T] m/s
    yaw_rate: Array  # [T] rad/s
    acceleration: Array  # [T] m/s^2, longitudinal
    oncoming: Array  # [T] bool, the box centre lies in a lane whose direction is against the route's
    wrong_way: Array  # [T] bool, the box centre lies in an oncoming lane that may not be used to overtake
    in_one_lane: Array  # [T] bool, the whole box lies in a single lane
    in_junction: Array  # [T] bool, the box centre does
    lane_offset: Array  # [T] m, of the box centre from the centre of the lane it is in
    road_margin: Array  # [T] m, from the outermost point of the box to the edge of the road, negative outside
    ran_red: Array  # [T] bool, the front bumper crossed a stop line at red since the step before
    ego: Objects  # [T], its box
    others: Objects  # [T, V], with their kinds
    touches: Array  # [T, V] bool, boxes overlap
    first_touch: Array  # [T, V] bool, and had not before in this drive
    goal: Array  # [] m, station
    limit: Array  # [] s
    reached: Array  # [] bool, the goal within the limit

    @property
    def duration(self) -> Array:
        """[] s, until the drive ends."""
        return jnp.max(jnp.where(self.alive, self.time, 0))

    @property
    def way(self) -> Array:
        """[] m along the route, from the start to where the drive ends."""
        return self.station[jnp.sum(self.alive) - 1] - self.station[0]


def facts(log: Log, case: Case, *, vehicle: VehicleParams) -> Facts:
    """What happened. Args: log [T], of one run of the case; case, not stacked; vehicle, the ego's dimensions."""
    everybody = tracks(log, vehicle).with_kinds()
    ego, others = (jax.tree.map(take, everybody) for take in (lambda x: x[:, 0], lambda x: x[:, 1:]))
    place = jax.vmap(lambda position, heading: progress(case.corridor, position, heading=heading))(
        ego.position, ego.heading
    )
    lane = _lane(case, place, ego, log.offset)
    time = log.time - log.time[0]
    passed = at_goal(log, case, station=place.station, ego=ego)
    earlier = jnp.concatenate([jnp.zeros((1,), bool), jnp.cumsum(passed)[:-1] > 0])
    alive = ~earlier & (time <= case.limit + ROUNDING)
    touches = _touches(ego, others) & alive[:, None]
    return Facts(
        time=time,
        alive=alive,
        station=place.station,
        offset=place.offset,
        heading_error=place.heading_error,
        along=ego.speed * jnp.cos(place.heading_error) * jnp.where(lane.oncoming, -1, 1),
        speed_limit=lane.speed_limit,
        yaw_rate=log.ego.speed * jnp.tan(log.ego.steering) / vehicle.wheelbase,
        acceleration=log.ego.acceleration,
        oncoming=lane.oncoming,
        wrong_way=lane.oncoming & ~lane.permitted & alive,
        in_one_lane=lane.whole,
        in_junction=lane.junction,
        lane_offset=lane.offset,
        road_margin=jnp.where(_mapped(case.corridor, place, vehicle), log.road_margin, INSIDE),
        ran_red=_ran_red(log, case, place.station + vehicle.length / 2) & alive,
        ego=ego,
        others=others,
        touches=touches,
        first_touch=touches & (jnp.cumsum(touches, axis=0) == 1),
        goal=case.goal,
        limit=case.limit,
        reached=jnp.any(passed & alive),
    )


def at_goal(log: Log, case: Case, *, station: Float[Array, " t"], ego: Objects) -> Bool[Array, " t"]:
    """In which steps the goal is reached: passed on the route, or in all that the case's aim asks for.

    Args: log [T], of one run or a part of it; case, not stacked; station [T] m, of the box centre; ego [T], its box.
    """
    if case.aim is None:
        return station >= case.goal
    return arrived(case.aim, time=log.time, position=ego.position, heading=ego.heading, speed=ego.speed)


def _mapped(corridor: Corridor, place: Progress, vehicle: VehicleParams) -> Bool[Array, " t"]:
    """Whether the whole box lies between where the route enters the map and where it leaves it."""
    reach = vehicle.length / 2 + INSIDE
    return (place.station > reach) & (place.station + reach < corridor.length)


@pytree
class _LaneThere:
    """The lane across the route that a box centre lies in, [T]."""

    offset: Array
    oncoming: Array
    permitted: Array  # to be entered from the route's lane
    whole: Array
    junction: Array
    speed_limit: Array


def _lane(case: Case, place: Progress, ego: Objects, marked: Float[Array, " t"]) -> _LaneThere:
    """The lane whose centre is nearest, in units of its width.

    Where the route changes lanes its reference line leaves the marked one, of whose centre the ego is `marked` m off.
    """
    corridor = case.corridor
    at = sample(corridor, place.station)
    away = jnp.abs(place.offset[:, None] - at.lane_offset) / at.lane_width
    q = jnp.argmin(jnp.where(at.has_lane, away, jnp.inf), axis=1)[:, None]

    def of_lane(values: Array) -> Array:
        return jnp.take_along_axis(values, q, axis=1)[:, 0]

    offset = place.offset - of_lane(at.lane_offset)
    cos, sin = jnp.abs(jnp.cos(place.heading_error)), jnp.abs(jnp.sin(place.heading_error))
    reach = (ego.width * cos + ego.length * sin) / 2
    return _LaneThere(
        offset=offset,
        oncoming=of_lane(at.oncoming),
        permitted=of_lane(_permitted(corridor, _rows(corridor, place.station))),
        whole=jnp.maximum(jnp.abs(offset), jnp.abs(marked)) + reach <= of_lane(at.lane_width) / 2,
        junction=case.lanes.graph.road_type[of_lane(corridor.lane_link[_rows(corridor, place.station)])]
        == RoadType.JUNCTION,
        speed_limit=at.speed_limit,
    )


def _rows(corridor: Corridor, station: Float[Array, " t"]) -> Int[Array, " t"]:
    """The rows of the corridor's table that are nearest to stations."""
    row = jnp.round((station - corridor.station[0]) / corridor.spacing).astype(jnp.int32)
    return jnp.clip(row, 0, corridor.station.shape[0] - 1)


def _permitted(corridor: Corridor, row: Int[Array, " t"]) -> Bool[Array, "t q"]:
    """Whether every change from the route's own lane to each lane is permitted there."""
    own, change = corridor.route_lane, corridor.change[row]
    left = jnp.cumprod(change[:, own:], axis=1) > 0
    right = jnp.cumprod(change[:, :own][:, ::-1], axis=1)[:, ::-1] > 0
    return jnp.concatenate([right, jnp.ones_like(right[:, :1]), left], axis=1)


def _ran_red(log: Log, case: Case, front: Float[Array, " t"]) -> Bool[Array, " t"]:
    """Steps in which a stop line came to lie behind the front bumper while its signal had been red."""
    road = case.corridor
    if case.lanes.graph.n_signals == 0:
        return jnp.zeros(front.shape, bool)
    shown = jax.vmap(lambda time: signals.show(case.start.signals, time).shown(road.stop_signal))(log.time)
    line = road.stop_station[None]
    crossed = (front[:-1, None] <= line) & (front[1:, None] > line) & road.has_stop[None]
    ran = jnp.any(crossed & (shown[:-1] == SignalState.RED), axis=1)
    return jnp.concatenate([jnp.zeros((1,), bool), ran])


def _touches(ego: Objects, others: Objects) -> Bool[Array, "t v"]:
    own = jax.tree.map(lambda x: x[:, None], box(ego.position, ego.heading, length=ego.length, width=ego.width))
    theirs = box(others.position, others.heading, length=others.length, width=others.width)
    return overlap(own, theirs) & others.valid
