"""The world: ego, traffic and signals; one policy step of it, and what the ego observes of it."""

from typing import ClassVar

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.numerics import safe
from urbanjax.numerics.soft import Relaxation
from urbanjax.roadmap.locate import LocateParams, follow
from urbanjax.sim import agents, mobil, priority, reaction, replay, scripts, signals
from urbanjax.sim.agents import Traffic, TrafficParams
from urbanjax.sim.lanes import LaneTables
from urbanjax.sim.lidar import LidarParams
from urbanjax.sim.neighbours import FAR, Bodies, look_ahead
from urbanjax.sim.reaction import Presence, ReactionParams
from urbanjax.sim.replay import Replay
from urbanjax.sim.scripts import Script
from urbanjax.sim.sensing import Sensing, sensed
from urbanjax.sim.signals import SignalPhases, SignalProgram
from urbanjax.types import (
    HANDED_DOWN,
    Command,
    Objects,
    Observation,
    Odometry,
    Signals,
    Unread,
    VehicleState,
    field,
    pytree,
    static,
)
from urbanjax.vehicle.following import free_acceleration
from urbanjax.vehicle.model import bicycle_step, box_centre
from urbanjax.vehicle.params import VehicleParams

HARD = Relaxation()


@pytree
class SimParams:
    """Parameters of the simulator."""

    PINNED: ClassVar[dict[str, str]] = {"*": "fact: of the world that is driven in"}

    UNREAD: ClassVar[dict[str, Unread | None]] = {
        "locate.max_distance": Unread("the ego is followed from link to link"),
        "locate.connectivity_penalty": Unread("the ego is followed from link to link"),
    }

    vehicle: VehicleParams = field(default=None, metadata=HANDED_DOWN)  # the ego
    lidar: LidarParams = field(default=None, metadata=HANDED_DOWN)  # of an ego that finds its pose from scans
    traffic: TrafficParams = TrafficParams()
    reaction: ReactionParams = ReactionParams()
    locate: LocateParams = LocateParams()  # of the ego, as traffic sees it
    range: float = 100.0  # m, within which the ego perceives objects
    n_objects: int = static(default=16)  # the nearest ones are observed
    substeps: int = static(default=2)  # per policy step; a substep should not exceed 0.05 s
    lane_changes: bool = static(default=True)  # traffic changes lanes (MOBIL)


@pytree
class WorldState:
    """Everything that moves."""

    ego: VehicleState
    ego_link: Array  # [] int32, the link that the ego is on
    traffic: Traffic
    signals: SignalProgram | SignalPhases
    time: Array  # [] s
    count: Array  # [] int32, policy steps so far
    replay: Replay | None = None  # recorded road users; simulated traffic does not see them
    ego_route: Array | None = None  # [] int32, successor that traffic takes the ego to choose at forks; None: the first
    script: Script | None = None  # what some of the traffic does at given times


@pytree
class Snapshot:
    """One look at the world: what observing, recording and stepping it all need."""

    centre: Array  # [2] m, of the ego's box
    ego_link: Array  # [] int32, the link that the ego is on now
    others: Objects  # [V] all other road users, simulated and recorded
    signals: Signals


def look(params: SimParams, lanes: LaneTables, *, world: WorldState) -> Snapshot:
    """What there is to see of the world now; done once per policy step. Args: lanes, of the road; world, now."""
    centre = box_centre(world.ego, params.vehicle)
    return Snapshot(
        centre=centre,
        ego_link=follow(
            lanes.graph,
            world.ego_link,
            ways=lanes.ways,
            position=centre,
            heading=world.ego.heading,
            params=params.locate,
        ),
        others=everybody(params, lanes, world=world),
        signals=signals.show(world.signals, world.time),
    )


def step(
    params: SimParams,
    lanes: LaneTables,
    world: WorldState,
    command: Command,
    dt: float | Float[Array, ""],
    relaxation: Relaxation = HARD,
    seen: Snapshot | None = None,
) -> WorldState:
    """World after one policy step of `dt` s under a constant command.

    Once per step: lane changes, right of way, signals, and where the ego is. In each substep: everybody's following
    (IDM) and motion. Differentiable with respect to the ego's state and command; who leads whom, lane changes and
    signals are hard choices. Args: lanes, of the road; world, now; command, of the ego; dt [] s; relaxation, of the
    traffic's reaction to the ego; seen, the look at the world where it was already taken.
    """
    seen = look(params, lanes, world=world) if seen is None else seen
    traffic, ego_presence, held = _decide(params, lanes, world, seen)
    small, script = dt / params.substeps, world.script

    def substep(carry: tuple, time: Array | None) -> tuple[tuple, None]:
        ego, traffic, presence, travelled = carry
        chain = agents.chain_of(lanes, traffic, params=params.traffic)
        to_ego = reaction.braking(
            presence, traffic, chain=chain, params=params.traffic, reaction=params.reaction, relaxation=relaxation
        )
        to_stop = agents.stop_braking(traffic, held.distance - travelled, params=params.traffic)
        strongest = jnp.maximum(jnp.maximum(to_ego, to_stop), held.braking)
        wanted = agents.follow(lanes, traffic, chain=chain, braking=strongest, params=params.traffic)
        pace = None
        if script is not None and time is not None:
            wanted = scripts.accelerated(script, wanted, time=time, dt=small)
            pace = scripts.paces(script, 1 / params.traffic.change_duration, time=time, dt=small)
        before = traffic.speed
        traffic = agents.move(lanes, traffic, acceleration=wanted, params=params.traffic, dt=small, pace=pace)
        ego = bicycle_step(ego, command, params=params.vehicle, dt=small)
        travelled = travelled + 0.5 * (before + traffic.speed) * small
        return (ego, traffic, reaction.advance(presence, small), travelled), None

    start = (world.ego, traffic, ego_presence, jnp.zeros_like(traffic.speed))
    times = None if script is None else world.time + small * jnp.arange(params.substeps, dtype=world.time.dtype)
    (ego, traffic, *_), _ = jax.lax.scan(substep, start, times, length=params.substeps, unroll=1)
    return world.replace(ego=ego, ego_link=seen.ego_link, traffic=traffic, time=world.time + dt, count=world.count + 1)


@pytree
class Held:
    """What holds traffic back for one policy step."""

    distance: Array  # [V] m from the front bumper to where it has to stop, FAR if nowhere
    braking: Array  # [V] m/s^2, towards the leader in a lane being left


def _decide(params: SimParams, lanes: LaneTables, world: WorldState, seen: Snapshot) -> tuple[Traffic, Presence, Held]:
    """The choices of one policy step: traffic with begun changes, the ego's presence, what holds traffic back."""
    p, traffic, ego = params.traffic, world.traffic, world.ego
    presence = reaction.presence(lanes, seen.ego_link, ego=ego, vehicle=params.vehicle, params=params.reaction)
    drivers = _drivers(lanes, world, presence, p)
    held = _holds(lanes, seen.signals, drivers, p)
    if params.lane_changes:
        left = world.count % 2 == 0
        traffic, held_braking = mobil.decide(lanes, traffic, drivers=drivers, left=left, params=p)
    else:
        held_braking = jnp.zeros_like(traffic.speed)
    return traffic, presence, Held(held, held_braking)


def _drivers(lanes: LaneTables, world: WorldState, seen: Presence, params: TrafficParams) -> mobil.Drivers:
    """Traffic and, last, the ego: it follows `ego_route` and drives like the default driver.

    An ego that is outside its own lane (off the road, or on the oncoming side) has no say here.
    """
    traffic, present = world.traffic, seen.reach[reaction.BASE] > 0
    side = jnp.where(seen.reach[reaction.LEFT] > seen.reach[reaction.RIGHT], reaction.LEFT, reaction.RIGHT)
    intrudes = present & seen.exists[side] & (seen.reach[side] > 0)
    other_station = jnp.where(intrudes, seen.station[side], -FAR)

    def join(array: Array, ego: Array | float | int) -> Array:
        return jnp.concatenate([array, jnp.asarray(ego, array.dtype)[None]])

    them = agents.bodies_of(traffic)
    bodies = Bodies(
        join(them.link, seen.link[0]),
        join(them.station, jnp.where(present, seen.station[0], -FAR)),
        join(them.other, seen.link[side]),
        join(them.other_station, other_station),
        join(them.half, 0.5 * seen.length),
        join(them.speed, jnp.maximum(seen.speed[0], 0.0)),
    )
    own = 0 if world.ego_route is None else world.ego_route
    route, exists = join(traffic.route, own), join(traffic.valid, present)
    chain = look_ahead(lanes, bodies.link, station=bodies.station, choice=route, exists=exists, n_links=params.n_links)
    headway = join(traffic.headway, params.idm.time_headway)
    factor = join(traffic.desired_speed, 1.0)
    free = free_acceleration(
        bodies.speed,
        agents.wanted_speed(lanes, factor, chain=chain, params=params),
        params=params.idm,
    )
    return mobil.Drivers(bodies, chain, route, exists, free, headway)


def _holds(lanes: LaneTables, shown: Signals, drivers: mobil.Drivers, params: TrafficParams) -> Array:
    """Distance to where each vehicle has to stop [V] m: red signal, end of the lane, right of way."""
    bodies, chain = drivers.bodies, drivers.chain
    red = priority.red_distance(
        lanes.graph, shown, chain=chain, front=bodies.half, speed=bodies.speed, deceleration=params.idm.deceleration
    )
    end = priority.end_distance(lanes, chain, front=bodies.half)
    way = priority.yield_distance(
        lanes,
        bodies,
        chain=chain,
        stopped=red < 0.5 * FAR,
        patience=params.patience,
        conflict_range=params.conflict_range,
        deceleration=params.idm.deceleration,
    )
    return jnp.minimum(jnp.minimum(red, end), way)[:-1]


def observe(
    params: SimParams,
    lanes: LaneTables,
    *,
    world: WorldState,
    seen: Snapshot | None = None,
    sensing: Sensing | None = None,
) -> Observation:
    """What the ego perceives: its pose, odometry, the nearest objects within range, and all signals.

    With `sensing` it is not told its pose, see `sensing.sensed`. Args: lanes, of the road; world, now; seen, the look
    at it where it was already taken; sensing, what its LiDAR meets beyond the road users.
    """
    ego = world.ego
    seen = look(params, lanes, world=world) if seen is None else seen
    yaw_rate = ego.speed * jnp.tan(ego.steering) / params.vehicle.wheelbase
    given = Observation(
        odometry=Odometry(ego.speed, ego.acceleration, ego.steering, yaw_rate),
        objects=nearest_objects(params, seen.others, centre=seen.centre),
        signals=seen.signals,
        pose=ego.pose,
    )
    if sensing is None:
        return given
    return sensed(params.lidar, sensing, given=given, ego=ego, others=seen.others, time=world.time, count=world.count)


def everybody(params: SimParams, lanes: LaneTables, *, world: WorldState) -> Objects:
    """All other road users [V], simulated and recorded. Args: lanes, of the road; world, now."""
    vehicles = agents.objects(lanes, world.traffic, params=params.traffic, script=world.script)
    if world.replay is None:
        return vehicles
    recorded = replay.objects(world.replay, world.time)
    vehicles = vehicles if recorded.kind is None else vehicles.with_kinds()
    return jax.tree.map(lambda a, b: jnp.concatenate([a, b]), vehicles, recorded)


def nearest_objects(params: SimParams, objects: Objects, *, centre: Float[Array, "2"]) -> Objects:
    """The nearest valid objects within range, nearest first, padded to `n_objects`.

    Args: objects [V]; centre [2] m, of the ego's box.
    """
    distance = safe.norm(objects.position - centre[None, :])
    inside = objects.valid & (distance < params.range)
    distance = jax.lax.stop_gradient(jnp.where(inside, distance, FAR))
    objects = objects.replace(valid=inside)
    missing = params.n_objects - distance.shape[0]
    if missing > 0:
        distance = jnp.pad(distance, (0, missing), constant_values=FAR)
        objects = jax.tree.map(lambda x: jnp.pad(x, [(0, missing)] + [(0, 0)] * (x.ndim - 1)), objects)
    _, index = jax.lax.top_k(-distance, params.n_objects)
    return jax.tree.map(lambda x: x[index], objects)
