"""Right of way: who is let go first, where the ego waits for them, and how fast it may come there.

Gap acceptance. Of two who meet (`behavior.encounters`), the ego gives way where the other one has priority, or comes
first among equals, or cannot stop any more; unless the ego is through by `gap` before the other one comes, or the other
one is gone by `rest` before the ego comes. Who would have to brake harder than `hard_braking` to do so goes on.
"""

from typing import ClassVar

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.behavior import caps
from urbanjax.behavior.encounters import FAR, EncounterParams, encounters
from urbanjax.behavior.situation import Body
from urbanjax.numerics import lean, soft
from urbanjax.planning.basis import interpolate
from urbanjax.planning.prediction import SLOWEST
from urbanjax.planning.situation import Situation
from urbanjax.roadmap.corridor import Corridor
from urbanjax.types import POSITIVE, SOFT, field, pytree
from urbanjax.vehicle.driving import Driving
from urbanjax.vehicle.following import constant_headway_speed
from urbanjax.vehicle.limits import SHORTEST, stop_speed


@pytree
class RightOfWayParams:
    """The gaps that are accepted, and how one waits."""

    PINNED: ClassVar[dict[str, str]] = {
        "gap": "safety: the time by which the ego is through before another one comes",
        "merge_gap": "safety: the time by which the ego is in before another one comes",
        "rest": "safety: the time for which another one is gone before the ego comes",
        "margin": "safety: where the ego waits",
        "stopping": "safety: who is taken to stop for the ego",
        "reaction": "safety: who is taken to stop for the ego",
        "comfortable_braking": "safety: how hard it brakes to give way",
        "hard_braking": "safety: how hard it brakes to give way",
        "patience": "definition: of a rank",
        "*_scale": SOFT,
    }

    gap: float = 1.5  # s, by which the ego is through before the other one comes
    merge_gap: float = 2.5  # s, by which the ego is in before the other one comes
    merge_braking: float = field(default=1.5, metadata=POSITIVE)  # m/s^2, with which that one adapts to the ego's speed
    rest: float = 0.5  # s, for which the other one is gone before the ego comes
    margin: float = 1.5  # m, before the stretch that both use
    stopping: float = field(default=3.5, metadata=POSITIVE)  # m/s^2, with which one stops who has to give way
    reaction: float = 0.5  # s, until it begins to
    hard_braking: float = field(default=5.5, metadata=POSITIVE)  # m/s^2, beyond which the ego does not give way
    comfortable_braking: float = 4.0  # m/s^2, beyond which it brakes in full to give way
    patience: float = 10.0  # s, that one rank of priority is worth
    time_scale: float = 0.5  # s, that clearly is a gap
    length_scale: float = 1.0  # m
    braking_scale: float = 0.5  # m/s^2
    encounter: EncounterParams = EncounterParams()


@pytree
class GiveWay:
    """For whom the ego waits, and where."""

    degree: Array  # [B] degree to which it gives way to each
    distance: Array  # [B] m from the front bumper to where it waits for each
    clear: Array  # [B] s until each is gone
    needed: Array  # [B] m/s^2, to stop before the stretch that both use
    waits: Array  # [] degree to which it gives way to anybody
    on_foot: Array  # [B] degree to which each is a pedestrian
    merges: Array  # [B] degree to which each goes on in the ego's lane
    gap: Array  # [B] m from the front bumper to the rear of each, both measured to where their ways meet
    speed: Array  # [B] m/s of each


def give_way(
    situation: Situation, driving: Driving, *, body: Body, station: Float[Array, "k"], time: Float[Array, "k"]
) -> GiveWay:
    """For whom the ego waits on its route.

    Args: situation, of the step; driving, with RightOfWayParams; body, of the ego; station [K] m, along the route, of
    the rear axle from now on; time [K] s, when it would be there if nobody were.
    """
    params, relaxation, ways = driving.params, driving.relaxation, situation.ways
    assert ways is not None
    met = encounters(situation, driving.of(params.encounter), body=body)
    rank, line = rules_at(situation.window, met.enters)
    front, spacing = body.front - station[0], station[1] - station[0]

    def when(place: Array) -> Array:
        """Time [s] at which the rear axle comes to a station [m]; beyond the path it goes on as at its end."""
        beyond = lean.maximum(place - station[-1], 0.0) * (time[-1] - time[-2]) / spacing
        return interpolate(place, station[0], spacing, time) + beyond

    def clearly(x: Array, scale: float | Array) -> Array:
        return soft.above(x, 0.0, relaxation, scale=scale)

    ego_in, ego_out = when(met.enters - front), when(met.leaves + driving.vehicle.rear_overhang)
    pace = lean.maximum(ways.speed, SLOWEST)
    their_in, their_out = met.way_in / pace, met.way_out / pace
    ego_speed = spacing / lean.maximum(when(met.enters - front + spacing) - ego_in, 1e-2)
    adapting = lean.maximum(ways.speed - ego_speed, 0.0) / (2 * params.merge_braking)
    through = met.merges * (ego_in + params.merge_gap + adapting) + (1 - met.merges) * (ego_out + params.gap)
    first = clearly(their_in - through, params.time_scale)
    after = clearly(ego_in - their_out - params.rest, params.time_scale)
    stops_in = ways.speed * params.reaction + ways.speed**2 / (2 * params.stopping)
    committed = clearly(stops_in - met.way_in, params.length_scale)
    ahead_of = params.patience * (rank - met.rank + 2 * committed + 4 * ways.on_foot) + ego_in - their_in
    to_zone = met.enters - params.margin / 2 - body.front
    # One who merges has to be followed, not to be stopped for.
    closing = lean.maximum(body.speed - met.merges * ways.speed, 0.0)
    needed = closing**2 / (2 * lean.maximum(to_zone, SHORTEST))
    can = clearly(params.hard_braking - needed, params.braking_scale)
    can = soft.either(can, ways.on_foot) * clearly(to_zone + params.margin / 2, params.length_scale)
    degree = met.meets * soft.negate(first) * soft.negate(after) * clearly(ahead_of, params.time_scale) * can
    before_line = clearly(line - body.front + params.margin, params.length_scale)
    wait = met.enters - params.margin
    wait = wait + before_line * (lean.minimum(line, wait) - wait)
    return GiveWay(
        degree=degree,
        distance=wait - body.front,
        clear=their_out + params.rest,
        needed=needed,
        waits=1 - jnp.prod(1 - degree),
        on_foot=ways.on_foot,
        merges=met.merges,
        gap=met.enters - body.front - met.way_out,
        speed=ways.speed,
    )


def rules_at(window: Corridor, station: Float[Array, "b"]) -> tuple[Float[Array, "b"], Float[Array, "b"]]:
    """Rank of the route and line to wait at (m), [B] each, at the rows nearest to stations.

    Args: window, the lanes around the vehicle; station [B] m.
    """
    row = jnp.round((station - window.station[0]) / window.spacing)
    row = jnp.clip(row, 0, window.station.shape[0] - 1).astype(jnp.int32)
    rules = lean.rows(jnp.stack([window.rank, window.line], axis=-1), row)
    return rules[:, 0], rules[:, 1]


def speed(way: GiveWay, driving: Driving, *, speed: Float[Array, ""], cap: Float[Array, ""]) -> Float[Array, ""]:
    """Highest speed now [] m/s, from which the ego can still wait for everybody it gives way to.

    It may roll on so as to come when the other one is gone, as long as it could still stop; one who merges it follows,
    as if both were in one lane already. Args: way, who is given way to; driving, with BehaviorParams; speed [] m/s, the
    present one; cap [] m/s, without anybody.
    """
    params, relaxation = driving.params, driving.relaxation
    now, cap = (jnp.broadcast_to(x, way.distance.shape) for x in (speed, cap))
    stop = caps.stop_before(now, way.distance, params=params.caps)
    still = stop_speed(way.distance, params.caps.stop_hardest, reaction_time=params.caps.reaction_time)
    rolling = lean.minimum(lean.maximum(way.distance, 0.0) / lean.maximum(way.clear, 0.1), still)
    follow = constant_headway_speed(now, way.gap, front_speed=way.speed, cap=cap, params=params.headway)
    allowed = lean.maximum(stop, lean.maximum(rolling * (1 - way.on_foot), way.merges * follow))
    bounds = cap - way.degree * lean.maximum(cap - allowed, 0.0)
    return soft.minimum(jnp.append(bounds, cap[:1]), relaxation, scale=0.5)


def goes_on(way: GiveWay, driving: Driving, *, distance: Float[Array, "k"]) -> Float[Array, "k"]:
    """Degree [K] to which the ego drives on at places of its path, and does not wait before them.

    Args: way, who is given way to; driving, with RightOfWayParams; distance [K] m, of the places from the ego.
    """
    params, relaxation = driving.params, driving.relaxation
    nearest = soft.minimum(way.distance + (1 - way.degree) * FAR, relaxation, scale=params.length_scale)
    return 1 - way.waits * soft.above(distance - nearest, 0.0, relaxation, scale=params.length_scale)


def urgent(way: GiveWay, driving: Driving) -> Float[Array, ""]:
    """Degree to which giving way takes full braking. Args: way, who is given way to; driving, with BehaviorParams."""
    params = driving.params.right_of_way
    asked = soft.above(way.needed, params.comfortable_braking, driving.relaxation, scale=params.braking_scale)
    return 1 - jnp.prod(1 - way.degree * asked)
