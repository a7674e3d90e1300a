"""What every family of situations returns, and how its vehicles are put on the road."""

import jax.numpy as jnp
from jax import Array

from urbanjax.sim.agents import Traffic, TrafficParams
from urbanjax.sim.signals import SignalProgram
from urbanjax.sim.world import WorldState
from urbanjax.types import VehicleState, pytree


@pytree
class Scenario:
    """A start. Road and route are the same for all starts of a family, so that they share one compiled program."""

    world: WorldState
    start_link: Array  # [] int32, first link of the ego's route
    goal_link: Array  # [] int32, last one
    crowded: Array  # [] bool, there is traffic beside the ego's lane


def traffic(
    link: Array, station: Array, *, speed: Array, limit: float | Array, params: TrafficParams, valid: Array
) -> Traffic:
    """Vehicles in the centre of their lanes that want to keep their speed; they follow, and do not change lanes.

    Args: link [V]; station [V] m; speed [V] m/s; limit [m/s], of all roads; valid [V] bool.
    """
    zero, no = jnp.zeros_like(station), jnp.zeros(link.shape, bool)
    return Traffic(
        link=link,
        station=station,
        offset=zero,
        speed=speed,
        acceleration=zero,
        offset_from=zero,
        offset_to=zero,
        moved=zero + 1,
        cooldown=zero,
        other=link,
        other_station=zero,
        has_other=no,
        length=zero + params.vehicle_length,
        width=zero + params.vehicle_width,
        desired_speed=speed / limit,
        headway=zero + params.idm.time_headway,
        politeness=zero + params.politeness,
        route=jnp.zeros_like(link),
        changes=no,
        reacts=~no,
        valid=valid,
    )


def no_signals() -> SignalProgram:
    """A program without signals."""
    none = jnp.zeros(0)
    return SignalProgram(none, none, none, none)


def ego_at(x: Array, y: Array, *, speed: Array) -> VehicleState:
    """The ego's rear axle at (x, y) [m], heading along x, steering straight. Args: x and y [] m; speed [] m/s."""
    zero = jnp.zeros_like(speed)
    return VehicleState(jnp.stack([x, y]), zero, speed, zero, zero)


def world(ego: VehicleState, ego_link: int, *, vehicles: Traffic) -> WorldState:
    """The world at time 0. Args: ego, its state; ego_link, the link it is on; vehicles, the traffic."""
    return WorldState(
        ego,
        jnp.asarray(ego_link, jnp.int32),
        vehicles,
        no_signals(),
        jnp.zeros_like(ego.speed),
        jnp.asarray(0, jnp.int32),
    )
