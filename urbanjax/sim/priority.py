"""Where traffic has to stop: red signals, ends of lanes, and others' right of way at junctions.

Right of way is a simple gap acceptance. A driver claims its next link for the time at which it would enter, later by
`patience` for each rank below priority (yield or stop sign, left turn or U-turn). Of two drivers whose next links
conflict inside a junction, or are one link entered from two others, the earlier claim goes first; whoever is inside
the junction, or can no longer stop, has gone already. A stop sign is a yield sign: the full stop is not enforced.
Drivers without priority may wait for ever in dense traffic.
"""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from urbanjax.numerics import safe
from urbanjax.roadmap.graph import RoadGraph, RoadType
from urbanjax.roadmap.priority import rank
from urbanjax.sim.lanes import LaneTables, take
from urbanjax.sim.neighbours import FAR, Bodies, Chain
from urbanjax.types import Signals, SignalState
from urbanjax.vehicle.limits import stopping_distance

GONE = -1e3  # s, claim of a driver who is in the junction or cannot stop before it; told by half of it
PAST = 1.0  # m behind the front bumper, from which on a stop line does not count any more
SLOWEST = 1.0  # m/s, for which the time to the junction is reckoned at least: who stands comes some time, too
TIE = 1e-3  # s per link number: breaks ties of drivers who come symmetrically
HARD_BRAKING = 1.5  # of the comfortable deceleration: who would need more to stop goes
AT_LINE = 0.1  # m, below which the distance to stop in counts as this one: who stands at the line is not committed


def red_distance(
    graph: RoadGraph,
    signals: Signals,
    *,
    chain: Chain,
    front: Float[Array, " n"],
    speed: Float[Array, " n"],
    deceleration: float | Array,
) -> Float[Array, " n"]:
    """Distance from the front bumper to the stop line of the next red signal [m], FAR if none; two links ahead.

    A yellow one counts while braking at `deceleration` is enough. A stop line more than 1 m behind is past. Args:
    graph, the road graph; signals, what they show; chain, the links ahead of N drivers; front [N] m, from the box
    centre to the front bumper; speed [N] m/s; deceleration [m/s^2], positive.
    """
    if graph.n_signals == 0:
        return jnp.full(front.shape, FAR, front.dtype)
    shown = signals.shown(graph.signal)
    red = jnp.min(jnp.where(graph.has_signal & (shown == SignalState.RED), graph.stop_line, FAR), axis=-1)
    yellow = jnp.min(jnp.where(graph.has_signal & (shown == SignalState.YELLOW), graph.stop_line, FAR), axis=-1)
    found = jnp.full(front.shape, FAR, front.dtype)
    for m in range(min(2, chain.link.shape[0])):
        link, start = chain.link[m], chain.start[m] - front
        is_link = start > -0.5 * FAR
        to_red, to_yellow = take(red, link) + start, take(yellow, link) + start
        found = jnp.where(is_link & (to_red > -PAST), jnp.minimum(found, to_red), found)
        can_stop = speed * speed < 2 * deceleration * to_yellow
        found = jnp.where(is_link & can_stop, jnp.minimum(found, to_yellow), found)
    return found


def end_distance(lanes: LaneTables, chain: Chain, *, front: Float[Array, " n"]) -> Float[Array, " n"]:
    """Distance from the front bumper to where the lane ends beside one that goes on [m], FAR if it does not.

    Args: lanes, the simulator's tables; chain, the links ahead of N drivers; front [N] m, from the box centre to the
    front bumper.
    """
    to_end = chain.start + take(lanes.graph.length, chain.link)
    ends = take(lanes.ends, chain.link) & (chain.start > -0.5 * FAR)
    return safe.minimum(jnp.where(ends, to_end, FAR), 0) - front


def yield_distance(
    lanes: LaneTables,
    bodies: Bodies,
    *,
    chain: Chain,
    stopped: Bool[Array, " n"],
    patience: float | Array,
    conflict_range: float | Array,
    deceleration: float | Array,
) -> Float[Array, " n"]:
    """Distance from the front bumper to the end of the link where the driver has to give way [m], FAR if it need not.

    Others are watched within `conflict_range` and the stopping distance. Args: lanes, the simulator's tables; bodies
    and chain, of all vehicles that take part; stopped [N] bool, those held by a red signal, who claim nothing; patience
    [s]; conflict_range [m]; deceleration [m/s^2], positive.
    """
    if not lanes.has_conflicts or chain.link.shape[0] < 2:
        return jnp.full(bodies.speed.shape, FAR, bodies.speed.dtype)
    here, there = chain.link[0], chain.link[1]
    distance = jnp.where(chain.start[1] > -0.5 * FAR, chain.start[1] - bodies.half, FAR)
    claim = jnp.where(stopped, FAR, _claim(lanes.graph, here, there, distance, bodies.speed, patience, deceleration))
    inside = jnp.where(chain.start[0] > -0.5 * FAR, GONE, FAR)
    inside_other = jnp.where(bodies.other_station > -0.5 * FAR, GONE, FAR)
    nobody = jnp.full(lanes.graph.length.shape, FAR, distance.dtype)
    entered = nobody.at[there].min(claim).at[here].min(inside).at[bodies.other].min(inside_other)
    crossing = jnp.min(jnp.where(take(lanes.has_rival, there), take(entered, take(lanes.rival, there)), FAR), axis=-1)
    rival = jnp.minimum(crossing, _merging(lanes.graph, here, there, nobody, claim))
    watched = distance < conflict_range + stopping_distance(bodies.speed, deceleration)
    return jnp.where((rival < claim) & (claim > 0.5 * GONE) & watched, distance, FAR)


def _claim(
    graph: RoadGraph,
    here: Array,
    there: Array,
    distance: Array,
    speed: Array,
    patience: float | Array,
    deceleration: float | Array,
) -> Array:
    """Time at which each driver claims its next link [s]: entering, plus `patience` per rank below priority."""
    below = rank(take(graph.rule, here), take(graph.turn, there), like=distance)
    claim = distance / jnp.maximum(speed, SLOWEST) + patience * below + TIE * here
    committed = stopping_distance(speed, HARD_BRAKING * deceleration) > jnp.maximum(distance, AT_LINE)
    return jnp.where(committed, GONE, claim).astype(distance.dtype)


def _merging(graph: RoadGraph, here: Array, there: Array, nobody: Array, claim: Array) -> Array:
    """Earliest claim [s] on `there` from another link than `here`; inside a junction that was settled before it."""
    approach = nobody.at[here].min(claim)
    before = take(graph.predecessor, there)
    others = take(graph.has_predecessor, there) & (before != here[:, None])
    rival = jnp.min(jnp.where(others, take(approach, before), FAR), axis=-1)
    return jnp.where(take(graph.road_type, here) == RoadType.JUNCTION, FAR, rival)
