"""The driving score of the CARLA leaderboard, with the coefficients of version 2.0, as Bench2Drive counts them too.

Driving score = 100 * route completion * (1 - share of the way outside the lanes) * product of coefficient^count.

| infraction | coefficient | in this world |
|---|---|---|
| collision with a pedestrian | 0.50 | yes |
| collision with a vehicle | 0.60 | yes; cyclists are vehicles, as there |
| collision with a static object | 0.65 | yes: a vehicle that never moves while the drive lasts |
| red light | 0.70 | yes, once the front bumper has crossed the line (there: the tail) |
| stop sign | 0.80 | no: there are no stop signs |
| scenario timeout | 0.70 | no: nothing blocks the road for minutes to be let go then |
| yielding to an emergency vehicle | 0.70 | no: there are none |
| minimum speed | up to 0.70 | not counted, as in Bench2Drive (its counter is marked unused) |
| outside the route's lanes | its share | yes: outside the road, or against the direction of the lane |

A collision counts whoever's fault it is, once with each other road user, unless the ego stands (below 0.1 m/s) when it
begins; there, one within 5 m of the last one counted is left out too, and the same other may count again later. A
vehicle that never moves is there static only if it is a prop. Outside the road is the box centre when it is 0.5 m off:
told from the margin of the outline, as if the box were parallel to the edge. There is no penalty for the time running
out, but the way ends: route completion is the furthest station reached, a share of the way from the start to the goal.
Being blocked for long and leaving the route by 30 m end a route there; here the drive goes on to its limit.
"""

import jax.numpy as jnp
from jax import Array

from urbanjax.evaluation.facts import Facts
from urbanjax.evaluation.fault import SPEED_SCALE, first_touches
from urbanjax.evaluation.metrics import HARD
from urbanjax.numerics import safe, soft
from urbanjax.numerics.soft import Relaxation
from urbanjax.types import RoadUser, pytree

SHORTEST = 1e-3  # m, that a way counts as
EDGE_SCALE = 0.1  # m, natural scale of being off the road for the relaxation
AGAINST_SCALE = 0.5  # m/s, of driving against the direction


@pytree
class CarlaParams:
    """Coefficients and thresholds."""

    pedestrian: float = 0.50  # for each collision
    vehicle: float = 0.60  # for each collision
    static: float = 0.65  # for each collision
    red_light: float = 0.70  # for each
    still: float = 0.1  # m/s, below which the ego stands, and others do not move
    allowance: float = 0.5  # m, that the box centre may be outside


@pytree
class CarlaScore:
    """The driving score and its parts; counts are int32 in mode hard."""

    total: Array  # [] in [0, 100]
    completion: Array  # [] in [0, 1], the share of the route made
    outside: Array  # [] in [0, 1], the share of the way driven outside the lanes
    penalty: Array  # [] in [0, 1], product of the coefficients
    pedestrians: Array  # [] collisions with them
    vehicles: Array  # [] collisions with them
    statics: Array  # [] collisions with objects that never move
    red_lights: Array  # [] run


def score(facts: Facts, *, params: CarlaParams | None = None, relaxation: Relaxation = HARD) -> CarlaScore:
    """The driving score of one drive; see the table above.

    In mode soft counts of collisions are sums of degrees, with a gradient; red lights, kinds, lanes and the end of the
    drive stay what they are. Args: facts, of one drive; params, coefficients and thresholds; relaxation, hard or how
    soft.
    """
    params = CarlaParams() if params is None else params
    ego, others = facts.ego, facts.others.with_kinds()

    def fast(speed: Array) -> Array:
        """Degree to which somebody moves, at the threshold too."""
        return soft.negate(soft.above(-speed, -params.still, relaxation, scale=SPEED_SCALE))

    collided = jnp.sum(first_touches(facts, relaxation=relaxation) * fast(ego.speed)[:, None], axis=0)
    seen = others.valid & facts.alive[:, None]
    moves = fast(safe.maximum(jnp.where(seen, jnp.abs(others.speed), 0), 0))
    kind = jnp.max(jnp.where(seen, jnp.asarray(others.kind), 0), axis=0)
    pedestrian = (kind == RoadUser.PEDESTRIAN).astype(moves.dtype)
    static = (1 - moves) * (kind == RoadUser.VEHICLE)
    counts = {
        "pedestrians": jnp.sum(collided * pedestrian),
        "vehicles": jnp.sum(collided * (1 - pedestrian) * (1 - static)),
        "statics": jnp.sum(collided * static),
        "red_lights": jnp.sum(facts.ran_red & facts.alive).astype(moves.dtype),
    }
    coefficients = jnp.asarray((params.pedestrian, params.vehicle, params.static, params.red_light), ego.speed.dtype)
    penalty = jnp.prod(coefficients ** jnp.stack(list(counts.values())))
    route = jnp.maximum(facts.goal - facts.station[0], SHORTEST)
    furthest = safe.maximum(jnp.where(facts.alive, facts.station, facts.station[0])) - facts.station[0]
    completion = jnp.where(facts.reached, 1, jnp.clip(furthest / route, 0, 1))
    outside = _share_outside(facts, params, relaxation)
    total = 100 * completion * (1 - outside) * penalty
    if relaxation.mode == "hard":
        counts = {name: count.astype(jnp.int32) for name, count in counts.items()}
    return CarlaScore(total=total, completion=completion, outside=outside, penalty=penalty, **counts)


def _share_outside(facts: Facts, params: CarlaParams, relaxation: Relaxation) -> Array:
    """Share of the way driven with the box centre off the road or in a lane of the other direction."""
    allowed = params.allowance + facts.ego.width / 2
    off = soft.above(-facts.road_margin, allowed, relaxation, scale=EDGE_SCALE)
    wrong = soft.above(-facts.along, params.still, relaxation, scale=AGAINST_SCALE)
    steps = jnp.abs(facts.station[1:] - facts.station[:-1]) * facts.alive[1:]
    return jnp.sum(soft.either(off, wrong)[1:] * steps) / jnp.maximum(jnp.sum(steps), SHORTEST)
