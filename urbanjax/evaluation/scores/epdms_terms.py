"""The terms of the EPDMS, each from the facts of one window; see `epdms` for what they are and where they differ."""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, Int

from urbanjax.evaluation import comfort as feel
from urbanjax.evaluation.facts import Facts
from urbanjax.evaluation.fault import FaultRule, Faults, at_fault, bearing, boxes, further_than, touch
from urbanjax.geometry.boxes import Box
from urbanjax.numerics import safe, soft
from urbanjax.numerics.soft import Relaxation
from urbanjax.types import field, pytree, static
from urbanjax.vehicle.comfort import ComfortParams
from urbanjax.vehicle.params import VehicleParams

# Natural scales of the choices for the relaxation.
SPEED_SCALE = 0.1  # m/s, of standing
MARGIN_SCALE = 0.1  # m, at the edge of the road
AGAINST_SCALE = 0.5  # m, against the direction
WAY_SCALE = 0.5  # m, of the way that is some
OFFSET_SCALE = 0.1  # m, from the line
COMFORT_SCALE = 0.1  # share of a bound


@pytree
class EpdmsParams:
    """Thresholds and weights, as the devkit is configured; numbers of steps are of 0.1 s."""

    still: float = 0.05  # m/s, at or below which somebody stands in a collision
    behind: float = 150.0  # deg off the heading, above which somebody is behind
    ahead: float = 30.0  # deg off the heading, below which somebody is ahead
    against: float = 2.0  # m, outside the route's direction from which on half is lost
    far_against: float = 6.0  # m, from which on all is
    against_steps: int = static(default=10)  # within which
    some_way: float = 5.0  # m, if nobody makes more of it, all have made all
    ttc_still: float = 0.005  # m/s, below which the ego has no time to collision
    ttc_steps: tuple[int, ...] = static(default=(0, 3, 6, 9))  # ahead, rising
    ttc_period: float = 0.1  # s, of one of them
    deviation: float = 0.5  # m, from the line
    deviation_steps: int = static(default=20)  # on end, with which the lane is not kept
    comfort: ComfortParams = field(default_factory=ComfortParams)
    progress_weight: float = 5.0
    ttc_weight: float = 5.0
    lane_keeping_weight: float = 2.0
    history_comfort_weight: float = 2.0
    extended_comfort_weight: float = 2.0


def begun(window: Facts) -> Facts:
    """The window as if the drive had begun with it, and nothing were known of what follows its end.

    Args: window [T], cut from a drive.
    """
    touches = window.touches & window.alive[:, None]
    later = jnp.arange(window.time.shape[0]) > 0
    return window.replace(
        touches=touches,
        first_touch=touches & (jnp.cumsum(touches, axis=0) == 1),
        ran_red=window.ran_red & window.alive & later,
    )


def faults(window: Facts, vehicle: VehicleParams, *, params: EpdmsParams, relaxation: Relaxation) -> Faults:
    """First touches in the window and whose fault they are.

    Args: window [T], begun; vehicle, the ego's dimensions; params; relaxation, hard or how soft.
    """
    return at_fault(window, vehicle, params=FaultRule(params.still, params.behind), relaxation=relaxation)


def gates(window: Facts, blamed: Faults, *, params: EpdmsParams, relaxation: Relaxation) -> dict[str, Array]:
    """The gates [] by name. Args: window [T], begun; blamed, its faults; params; relaxation, hard or how soft."""
    margin, forwards = (
        soft.minimum(values, relaxation, scale=scale, mask=window.alive)
        for values, scale in ((window.road_margin, MARGIN_SCALE), (-against(window, params), AGAINST_SCALE))
    )
    direction = [
        soft.above(forwards, -bound, relaxation, scale=AGAINST_SCALE) for bound in (params.against, params.far_against)
    ]
    return {
        "no_at_fault_collisions": jnp.prod(1 - jnp.sum(blamed.at_fault, axis=0)),
        "drivable_area_compliance": soft.negate(soft.above(-margin, 0.0, relaxation, scale=MARGIN_SCALE)),
        "driving_direction_compliance": (direction[0] + direction[1]) / 2,
        "traffic_light_compliance": 1 - jnp.any(window.ran_red).astype(margin.dtype),
    }


def against(window: Facts, params: EpdmsParams) -> Float[Array, " t"]:
    """The way [T] m of the box centre outside the lanes of the route's direction, in the last second of each step.

    Args: window [T], begun; params.
    """
    moved = safe.norm(window.ego.position[1:] - window.ego.position[:-1])
    outside = window.oncoming | (window.road_margin < -window.ego.width / 2)
    counts = (outside & ~window.in_junction & window.alive)[1:]
    so_far = jnp.concatenate([jnp.zeros_like(moved[:1]), jnp.cumsum(jnp.where(counts, moved, 0))])
    back = jnp.arange(so_far.shape[0]) - params.against_steps - 1
    return so_far - so_far[jnp.maximum(back, 0)]


def way(window: Facts) -> Float[Array, ""]:
    """The way [] m made along the route, none where it went backwards. Args: window [T], begun."""
    return jnp.maximum(window.way, 0)


def progress(made: Array, gate: Array, *, reference: Array, params: EpdmsParams, relaxation: Relaxation) -> Array:
    """The share [] of the way that could be made.

    Args: made [] m, the own way; gate [], the product of the own gates; reference [] m, the other way times its gates;
    params; relaxation, hard or how soft.
    """
    most = jnp.maximum(made * gate, reference)
    some = soft.above(most, params.some_way, relaxation, scale=WAY_SCALE)
    share = jnp.minimum(made / jnp.maximum(most, 0.5 * params.some_way), 1)  # its floor is out of reach where it counts
    return 1 - some + some * share


def infractions(
    window: Facts, vehicle: VehicleParams, *, params: EpdmsParams, relaxation: Relaxation
) -> Float[Array, "t v"]:
    """Degrees [T, V] to which an infraction of the time to collision begins with each of the others.

    Args: window [T], begun; vehicle, the ego's dimensions; params; relaxation, hard or how soft.
    """
    ego, (own, _) = window.ego, boxes(window)
    n = window.time.shape[0]
    at, last = jnp.arange(n), params.ttc_steps[-1]
    speed = jnp.abs(ego.speed)
    moves = soft.negate(soft.above(-speed, -params.ttc_still, relaxation, scale=SPEED_SCALE))
    looks = window.alive[jnp.minimum(at + last, n - 1)] & (at + last < n)
    wide = (~window.in_one_lane | window.in_junction)[:, None].astype(speed.dtype)

    def ahead(steps: Array) -> tuple[Array, Array]:
        """Degrees [T, V] to which the ego, moved on, meets where others will be, and to which that counts."""
        rows = jnp.minimum(at + steps, n - 1)
        then = window.replace(others=jax.tree.map(lambda x: x[rows], window.others))
        further = (speed * steps * params.ttc_period)[:, None]
        moved = Box(
            own.x + further * own.cos, own.y + further * own.sin, own.cos, own.sin, own.half_length, own.half_width
        )
        cosine = bearing(then, vehicle)
        before = soft.negate(further_than(cosine, params.ahead, relaxation=relaxation))
        beside = soft.negate(further_than(cosine, params.behind, relaxation=relaxation))
        there = then.others.valid & looks[:, None]
        meets = jnp.where(there, touch(moved, boxes(then)[1], relaxation=relaxation), 0)
        return moves[:, None] * meets, soft.either(before, soft.both(wide, beside))

    meets, counts = (
        jnp.moveaxis(x, 0, 1).reshape(n * len(params.ttc_steps), -1)
        for x in jax.vmap(ahead)(jnp.asarray(params.ttc_steps))
    )
    free = jnp.cumprod(1 - meets, axis=0)
    first = meets * jnp.concatenate([jnp.ones_like(free[:1]), free[:-1]])
    return jnp.sum((first * counts).reshape(n, len(params.ttc_steps), -1), axis=1)


def lane_keeping(window: Facts, params: EpdmsParams, *, relaxation: Relaxation) -> Float[Array, ""]:
    """Whether [] the route's line was never left for long; steps in junctions are as if they were not.

    Args: window [T], begun; params; relaxation, hard or how soft.
    """
    off = soft.above(jnp.abs(window.offset), params.deviation, relaxation, scale=OFFSET_SCALE)
    counts = window.alive & ~window.in_junction
    close = jnp.where(counts, off, 0)[jnp.argsort(~counts, stable=True)]
    long = params.deviation_steps
    spells = jnp.concatenate([close, jnp.zeros((long,), close.dtype)])
    spells = spells[jnp.arange(close.shape[0])[:, None] + jnp.arange(long)[None]]
    return jnp.prod(1 - jnp.prod(spells, axis=1))


def felt(window: Facts, before: Facts | None) -> tuple[feel.Smoothed, Int[Array, ""], Int[Array, ""]]:
    """What was felt in the steps before the window and in it, the first of them first; how many were before, and all.

    Args: window [T], begun; before [H], of which those alive count, the last ones.
    """
    ride, earlier = feel.motion(window), jnp.zeros((), jnp.int32)
    if before is not None:
        earlier = jnp.sum(before.alive, dtype=jnp.int32)
        unknown = before.alive.shape[0] - earlier
        ride = jax.tree.map(lambda a, b: jnp.roll(jnp.concatenate([a, b]), -unknown), feel.motion(before), ride)
    n = earlier + jnp.sum(window.alive, dtype=jnp.int32)
    return feel.smoothed(ride, n, spacing=feel.period(window)), earlier, n


def history_comfort(
    window: Facts, before: Facts | None, *, params: EpdmsParams, relaxation: Relaxation
) -> Float[Array, ""]:
    """Whether [] all bounds of comfort were kept.

    Args: window [T], begun; before [H], see `felt`; params; relaxation, hard or how soft.
    """
    steps, _, n = felt(window, before)
    room = feel.room(steps, params.comfort)
    known = jnp.broadcast_to(jnp.arange(room.shape[1])[None] < n, room.shape)
    least = soft.minimum(room, relaxation, scale=COMFORT_SCALE, mask=known)
    return jnp.prod(soft.above(least, 0.0, relaxation, scale=COMFORT_SCALE))
