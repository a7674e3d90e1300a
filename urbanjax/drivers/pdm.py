"""The driver that tries fifteen ways in its head and takes the best: PDM-Closed (Dauner et al., CoRL 2023)."""

import jax
import jax.numpy as jnp
import jaxlie
from jax import Array

from urbanjax.behavior.situation import closed_line
from urbanjax.behavior.surroundings import relate
from urbanjax.control.pure_pursuit import PurePursuitParams, steer
from urbanjax.course import Course
from urbanjax.geometry.boxes import box, corners
from urbanjax.localization import given
from urbanjax.numerics.soft import Relaxation
from urbanjax.roadmap.corridor import Corridor, WindowParams, window
from urbanjax.roadmap.nearby import LanesThere, lanes_at, nearby, thinned
from urbanjax.roadmap.progress import Progress, progress, to_world
from urbanjax.traffic.safety.faults import BlameParams, first_infractions, forecast, touching
from urbanjax.types import (
    HANDED_DOWN,
    Command,
    Objects,
    Observation,
    Path,
    Signals,
    VehicleState,
    field,
    pytree,
    static,
)
from urbanjax.vehicle.comfort import ComfortParams, comfortable
from urbanjax.vehicle.driving import Driving
from urbanjax.vehicle.following import IDMParams, free_acceleration, interaction
from urbanjax.vehicle.model import bicycle_step, box_centre
from urbanjax.vehicle.params import VehicleParams

AHEAD = 8  # points of the path that pure pursuit looks along
EVERY = 2  # steps, in which leaders are looked for, as in the published code
THINNED = 4  # stations, of which one is enough to see others from the road


@pytree
class PdmScoring:
    """Weights and bounds of the score; the paper's."""

    progress: float = 5.0  # weight of the way made, relative to that of the best proposal
    time_to_collision: float = 5.0  # weight of never coming too near in time
    comfort: float = 2.0  # weight
    standing: float = 0.1  # m, if no proposal makes more way, all have made all
    tolerated: float = 2.0  # m on the oncoming side, below which it counts nothing
    forbidden: float = 6.0  # m on the oncoming side, from which it counts all; between them half
    tie: float = 1e-3  # of the score, within which the first proposal of the list is as good as the best


@pytree
class PdmInfo:
    """What one step of the driver found, for P proposals: by offset, and in each from the fastest to the slowest."""

    scores: Array  # [P] in [0, 1]
    chosen: Array  # [] int32, the proposal that is driven
    braking: Array  # [] bool, in full, as that proposal comes too near to somebody


@pytree
class PdmWays:
    """What blocks the ways beside each other, at each of T times: O objects and, last, the next closed stop line."""

    middle: Array  # [T, O + 1] m, station
    rear: Array  # [T, O + 1] m, station of the end that one meets
    speed: Array  # [T, O + 1] m/s along the road
    blocks: Array  # [T, L, O + 1] bool, in the way at each of L offsets


@pytree
class PdmDriver:
    """The rule-based planner that leads nuPlan: IDM at several speeds and offsets, simulated, scored, the best driven.

    Not as published: The tracker is pure pursuit, not LQR, and what IDM asks for is what is simulated. A leader's
    distance is measured along the road, and a box across the lane is as wide there as its extent across. Times to
    collision know no junctions, and whom they concern is asked of the places at one time, not of the other's later one.
    Signals count as closed unless they are green, and as lines, not areas. Others have no class: all count as vehicles
    (a route they lack there, too). Emergency braking is the vehicle's fullest, at any speed and also for times to
    collision (published: below 5 m/s, and for collisions alone). Scores that differ by less than `tie` count as equal.
    The road does not end with the route, and is its lanes alone, also in junctions. Who is touched now is left out now,
    and not for good.
    """

    vehicle: VehicleParams = field(default=None, metadata=HANDED_DOWN)
    period: float = field(default=None, metadata=HANDED_DOWN)  # s, of one step
    following: IDMParams = IDMParams(
        acceleration=1.5, deceleration=3.0, time_headway=1.5, jam_distance=1.0, exponent=10.0
    )
    pursuit: PurePursuitParams = PurePursuitParams()
    window: WindowParams = WindowParams()
    faults: BlameParams = BlameParams()
    comfort: ComfortParams = ComfortParams()
    scoring: PdmScoring = PdmScoring()
    offsets: tuple[float, ...] = (0.0, 1.0, -1.0)  # m from the centre of the route's lane, left positive
    shares: tuple[float, ...] = (1.0, 0.8, 0.6, 0.4, 0.2)  # of the speed limit
    emergency: float = 2.0  # s, within which an infraction makes it brake in full
    n_steps: int = static(default=40)  # of the loop's period, for which proposals are simulated

    def init(self, course: Course, pose: jaxlie.SE2) -> Array:
        """The station [] m on the route. Args: course, of the drive; pose, T_world_body of the rear axle."""
        return progress(course.corridor, pose.translation(), heading=pose.rotation().as_radians()).station

    def step(self, course: Course, state: Array, observation: Observation) -> tuple[Command, Array, PdmInfo]:
        """One step. Args: course, of the drive; state, the station [] m; observation, with the pose."""
        ego = given.step(observation).vehicle_state(observation.odometry)
        road = window(course.corridor, state, params=self.window)
        here = progress(road, ego.position, heading=ego.heading)
        times = self.period * jnp.arange(self.n_steps + 1, dtype=ego.speed.dtype)
        others = forecast(self._apart(observation.objects, ego), times)
        ways = self._ways(road, others, observation.signals, here)
        commands, rides, stations = self._simulate(road, ego, here, ways)
        scores, infraction = self._score(road, rides, stations, others, times)
        best = jnp.argmax(scores >= jnp.max(scores) - self.scoring.tie).astype(jnp.int32)
        braking = infraction[best] <= self.emergency
        chosen = jax.tree.map(lambda x: x[best], commands)
        fullest = -jnp.minimum(self.vehicle.max_deceleration, ego.speed / self.period)  # no faster than to a stand
        command = chosen.replace(acceleration=jnp.where(braking, fullest, chosen.acceleration))
        return command, here.station, PdmInfo(scores, best, braking)

    def _apart(self, objects: Objects, ego: VehicleState) -> Objects:
        """The objects without those that the ego touches now, which no proposal can help."""
        met = touching(jax.tree.map(lambda x: x[None], self._body(ego)), objects)
        return objects.replace(valid=objects.valid & ~met)

    def _body(self, ride: VehicleState) -> Objects:
        """The vehicle's box as an object, of the ride's shape."""
        length, width = (jnp.full_like(ride.speed, size) for size in (self.vehicle.length, self.vehicle.width))
        there = jnp.ones(ride.speed.shape, bool)
        return Objects(box_centre(ride, self.vehicle), ride.heading, ride.speed, length, width, there)

    def _ways(self, road: Corridor, others: Objects, signals: Signals, here: Progress) -> PdmWays:
        """What blocks each of the ways. Args: others [T, O]."""
        seen = jax.tree.map(lambda x: x[::EVERY], others)
        around = jax.vmap(relate, (0, None))(seen, thinned(road, THINNED))
        around = jax.tree.map(lambda x: jnp.repeat(x, EVERY, axis=0)[: others.speed.shape[0]], around)
        aside = around.offset[:, None] - jnp.asarray(self.offsets, around.offset.dtype)[None, :, None]
        reach = around.half_width + self.vehicle.width / 2
        blocks = around.valid[:, None] & (jnp.abs(aside) < reach[:, None])
        line, closed = closed_line(road, signals, front=here.station + self._front)

        def add(x: Array, last: Array) -> Array:
            return jnp.concatenate([x, jnp.broadcast_to(last, (*x.shape[:-1], 1))], axis=-1)

        return PdmWays(
            middle=add(around.station, line),
            rear=add(around.station - around.half_length, line),
            speed=add(around.speed, jnp.zeros_like(line)),
            blocks=add(blocks, closed),
        )

    @property
    def _front(self) -> float | Array:
        """Metres from the rear axle to the front bumper."""
        return self.vehicle.length - self.vehicle.rear_overhang

    def _simulate(
        self, road: Corridor, ego: VehicleState, here: Progress, ways: PdmWays
    ) -> tuple[Command, VehicleState, Array]:
        """First commands [P], and states and stations [P, T] of all proposals."""
        dtype, n = ego.speed.dtype, len(self.shares)
        limit = jnp.interp(here.station, road.station, road.speed_limit)
        speeds = jnp.tile(limit * jnp.asarray(self.shares, dtype), len(self.offsets))
        offsets = jnp.repeat(jnp.asarray(self.offsets, dtype), n)

        def advance(carry: tuple[VehicleState, Array], now: PdmWays) -> tuple[tuple, tuple]:
            state, station = carry
            blocks = jnp.repeat(now.blocks, n, axis=0)
            acceleration = jax.vmap(self._accelerate, (0, 0, 0, 0, None))(state, station, speeds, blocks, now)
            steering = jax.vmap(self._steer, (None, 0, 0, 0))(road, state, station, offsets)
            command = Command(acceleration, steering)
            after = bicycle_step(state, command, params=self.vehicle, dt=self.period)
            way = 0.5 * (state.speed + after.speed) * self.period
            found = nearby(road, after.position, station=station + way)
            return (after, found), (command, after, found)

        start = jax.tree.map(lambda x: jnp.broadcast_to(x, (*speeds.shape, *x.shape)), (ego, here.station))
        steps = jax.tree.map(lambda x: x[:-1], ways)
        _, (commands, *after) = jax.lax.scan(advance, start, steps)
        join = jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), start, tuple(after))
        rides, stations = jax.tree.map(lambda x: jnp.moveaxis(x, 0, 1), join)
        return jax.tree.map(lambda x: x[0], commands), rides, stations

    def _accelerate(self, state: VehicleState, station: Array, desired: Array, blocks: Array, now: PdmWays) -> Array:
        """IDM's behind the nearest one that blocks the way. Args: blocks [O + 1], who does; now, at this time."""
        params = self.following
        gaps = jnp.where(blocks & (now.middle > station), now.rear - station - self._front, jnp.inf)
        nearest = jnp.argmin(gaps)
        held = interaction(state.speed, gaps[nearest], front_speed=now.speed[nearest], params=params)
        wanted = free_acceleration(state.speed, desired, params=params) - held
        low = -jnp.minimum(jnp.minimum(params.deceleration, self.vehicle.max_deceleration), state.speed / self.period)
        return jnp.clip(wanted, low, jnp.minimum(params.acceleration, self.vehicle.max_acceleration))

    def _steer(self, road: Corridor, state: VehicleState, station: Array, offset: Array) -> Array:
        """Pure pursuit's angle towards the line at one offset."""
        ahead = station + jnp.linspace(0, 1.1 * self.pursuit.maximum, AHEAD, dtype=station.dtype)
        beside = jnp.full_like(ahead, offset)
        path = Path(ahead, beside, *to_world(road, ahead, offset=beside))
        return steer(path, Driving(self.vehicle, self.pursuit, Relaxation(), self.period), state=state)

    def _score(
        self, road: Corridor, rides: VehicleState, stations: Array, others: Objects, times: Array
    ) -> tuple[Array, Array]:
        """Scores [P] and times [P] s of the first infractions. Args: rides, stations [P, T]; others [T, O]; times."""
        weights, body = self.scoring, self._body(rides)
        lanes, middle = self._lanes(road, body, stations)
        corner, centre = lanes.inside[..., :4, :], lanes.inside[..., 4, :] & ~lanes.oncoming[..., 4, :]
        off = ~jnp.all(jnp.any(corner, axis=-1), axis=-1)
        several = (jnp.sum(jnp.any(corner, axis=-2), axis=-1) > 1) & ~jnp.any(jnp.all(corner, axis=-2), axis=-1)
        judged = {"times": times, "apart": off | several, "axle": self.vehicle.centre_offset, "params": self.faults}
        collision, near = first_infractions(body, others, **judged)
        against = self._against(body.position, ~jnp.any(centre, axis=-1))
        direction = 1 - ((against >= weights.tolerated) + (against >= weights.forbidden)).astype(times.dtype) / 2
        allowed = jnp.where(jnp.isinf(collision) & ~jnp.any(off, axis=1), direction, 0)
        made = jnp.maximum(middle[:, -1] - middle[:, 0], 0) * allowed
        most = jnp.max(made)
        relative = jnp.where(most > weights.standing, made / jnp.maximum(most, weights.standing), jnp.sign(allowed))
        calm = comfortable(rides, self.vehicle, period=self.period, params=self.comfort)
        terms = (
            (weights.progress, relative),
            (weights.time_to_collision, jnp.isinf(near).astype(times.dtype)),
            (weights.comfort, calm.astype(times.dtype)),
        )
        total = sum(weight for weight, _ in terms)
        return allowed * sum(weight * term for weight, term in terms) / total, jnp.minimum(collision, near)

    def _lanes(self, road: Corridor, body: Objects, stations: Array) -> tuple[LanesThere, Array]:
        """Where corners and, last, centres are: lanes [P, T, 5, Q], and stations [P, T] m of the centres."""
        around = corners(box(body.position, body.heading, length=body.length, width=body.width))
        points = jnp.concatenate([around, body.position[:, :, None]], axis=2)
        found = nearby(road, points, station=jnp.broadcast_to(stations[..., None], points.shape[:-1]))
        return lanes_at(road, points, station=found), found[..., 4]

    def _against(self, centre: Array, wrong: Array) -> Array:
        """The longest way [P] m made at a stretch outside the lanes of the route's direction."""
        way = jnp.linalg.norm(jnp.diff(centre, axis=1, prepend=centre[:, :1]), axis=-1)
        total = jnp.cumsum(jnp.where(wrong, way, 0), axis=1)
        return jnp.max(total - jax.lax.cummax(jnp.where(wrong, 0, total), axis=1), axis=1)
