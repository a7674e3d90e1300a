"""Encounters with one other vehicle that does as scripted: numbers in ranges that real traffic has, and their world.

The other one does not react to the ego, so that what it does is stated by its numbers alone. Ranges are such that the
start is no collision, and that whoever sees the other one begin and brakes in full can still avoid it but in corners.
"""

from typing import Any

import jax.numpy as jnp
from jax import Array

from urbanjax.sim.scripts import Script
from urbanjax.sim.world import WorldState
from urbanjax.types import field, host_record, pytree


def _within(low: float, high: float, default: float) -> Any:
    """A number of a family: where searches begin, and what its transform keeps to."""
    return field(default=default, metadata={"range": (low, high)})


@pytree
class BrakingLeader:
    """The one ahead in a single lane, as fast as the ego, brakes to a stand."""

    # Of the limit, 50 km/h: nobody speeds.
    ego_speed: float = _within(0.6, 1.0, 0.8)
    # s, bumper to bumper at the ego's speed: the closer third of what drivers keep, never below half a second.
    time_gap: float = _within(0.5, 2.0, 1.2)
    # Of the ego's speed: followers close in slowly, or fall behind.
    leader_speed: float = _within(0.85, 1.1, 1.0)
    # s, after which it brakes: the driver has had time to take up its gap.
    brakes_at: float = _within(0.5, 3.0, 1.5)
    # m/s^2: from a firm stop to an emergency one on dry asphalt (UNECE R13-H asks for 6.43 at least).
    braking: float = _within(2.0, 8.0, 4.0)


@pytree
class CutIn:
    """One beside, slower than the ego, moves over before it, and may brake then."""

    # Of the limit, 50 km/h.
    ego_speed: float = _within(0.6, 1.0, 0.8)
    # s, bumper to bumper at the ego's speed, as it would be when the move begins: whoever leaves less leaves no choice.
    time_gap: float = _within(0.8, 2.5, 1.6)
    # Of the ego's speed: up to a third slower.
    other_speed: float = _within(0.65, 1.0, 0.85)
    # s, when the move begins.
    moves_at: float = _within(0.3, 2.0, 1.0)
    # s, that it lasts: recorded lane changes last 2 to 8 s, those that matter are the quick ones.
    moves_for: float = _within(2.0, 5.0, 3.0)
    # Share of the move after which it brakes: not before its front is in the lane.
    brakes_after: float = _within(0.5, 1.2, 0.8)
    # m/s^2: from lifting the foot to what the ego can do itself.
    braking: float = _within(0.5, 6.0, 2.0)


@pytree
class Crossing:
    """One with priority comes from the side, where the ego has to yield without signals; it may slow down to look."""

    # Of the limit, 50 km/h, 25 m before the junction: 2.8 m/s^2 are enough to stop.
    ego_speed: float = _within(0.5, 0.85, 0.7)
    # Of the limit: a tenth above it is common.
    other_speed: float = _within(0.5, 1.1, 0.8)
    # s, by which it would be at the crossing after the ego, did both keep their speed.
    later: float = _within(-2.5, 2.5, 0.0)
    # s, when it slows down.
    brakes_at: float = _within(0.5, 3.5, 2.0)
    # m/s^2: no more than comfortable, for it has priority.
    braking: float = _within(0.0, 2.5, 0.5)


@pytree
class Encounter:
    """What the numbers of any family come to: the ego's speed, and the one other vehicle. Differentiable throughout."""

    ego_speed: Array  # [] m/s
    station: Array  # [] m along its link, of the other's box centre
    speed: Array  # [] m/s, of the other, that it keeps until it brakes
    offset: Array  # [] m from the lane's centre, from which it moves over to there; 0: it is there already
    brakes_at: Array  # [] s
    braking: Array  # [] m/s^2, positive
    moves_at: Array  # [] s
    moves_for: Array  # [] s
    onset: Array  # [] s, before which nothing tells what it is going to do


@host_record
class EncounterPlace:
    """Where an encounter takes place, from the ego and from the other's link."""

    limit: float  # m/s
    front: float  # m, station of the ego's front bumper on the other's link, where they share it
    half: float  # m, half the other's length
    aside: float = 0.0  # m, offset of the lane beside from the ego's
    way: float = 0.0  # m, from the ego's front bumper to where the ways cross
    crossing: float = 0.0  # m, station of that on the other's link


def braking_leader(numbers: BrakingLeader, place: EncounterPlace) -> Encounter:
    """The leader ahead of the ego. Args: numbers, of the family; place, in one lane."""
    ego = jnp.asarray(numbers.ego_speed) * place.limit
    station = place.front + numbers.time_gap * ego + place.half
    still = jnp.zeros_like(ego)
    return Encounter(
        ego_speed=ego,
        station=station,
        speed=numbers.leader_speed * ego,
        offset=still,
        brakes_at=numbers.brakes_at + still,
        braking=numbers.braking + still,
        moves_at=still,
        moves_for=still + 1,
        onset=numbers.brakes_at + still,
    )


def cut_in(numbers: CutIn, place: EncounterPlace) -> Encounter:
    """The one beside, so far ahead that its gap is left when it moves.

    Args: numbers, of the family; place, on two lanes.
    """
    ego = jnp.asarray(numbers.ego_speed) * place.limit
    other, still = numbers.other_speed * ego, jnp.zeros_like(ego)
    gap = numbers.time_gap * ego + (ego - other) * numbers.moves_at
    return Encounter(
        ego_speed=ego,
        station=place.front + gap + place.half,
        speed=other,
        offset=still + place.aside,
        brakes_at=numbers.moves_at + numbers.brakes_after * numbers.moves_for + still,
        braking=numbers.braking + still,
        moves_at=numbers.moves_at + still,
        moves_for=numbers.moves_for + still,
        onset=numbers.moves_at + still,
    )


def crossing(numbers: Crossing, place: EncounterPlace) -> Encounter:
    """The one from the side. Args: numbers, of the family; place, at a junction."""
    ego, other = (jnp.asarray(share) * place.limit for share in (numbers.ego_speed, numbers.other_speed))
    still = jnp.zeros_like(ego)
    return Encounter(
        ego_speed=ego,
        station=place.crossing - other * (place.way / ego + numbers.later),
        speed=other,
        offset=still,
        brakes_at=numbers.brakes_at + still,
        braking=numbers.braking + still,
        moves_at=still,
        moves_for=still + 1,
        onset=still,  # it is in sight from the start
    )


def meet(world: WorldState, encounter: Encounter, *, limit: float | Array) -> WorldState:
    """The world with that encounter: the first vehicle is the other one; pure.

    Args: world, as `encounter_stages` makes it; encounter; limit [m/s], of the other's link.
    """

    def first(values: Array, value: Array) -> Array:
        return values.at[0].set(value.astype(values.dtype))

    them, moves = world.traffic, encounter.offset != 0
    changes = {
        "station": encounter.station,
        "other_station": encounter.station,
        "speed": encounter.speed,
        "desired_speed": encounter.speed / limit,
        "offset": encounter.offset,
        "offset_from": encounter.offset,
        "moved": jnp.where(moves, 0.0, 1.0),
    }
    them = them.replace(**{name: first(getattr(them, name), value) for name, value in changes.items()})
    script = Script(
        scripted=jnp.zeros_like(them.valid).at[0].set(True),
        **{
            name: first(jnp.ones_like(them.speed), getattr(encounter, name))
            for name in ("brakes_at", "braking", "moves_at", "moves_for")
        },
    )
    ego = world.ego.replace(speed=encounter.ego_speed.astype(world.ego.speed.dtype))
    return world.replace(ego=ego, traffic=them, script=script)
