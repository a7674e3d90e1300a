"""Worlds of recorded road users."""

import jax.numpy as jnp

from urbanjax.sim.agents import TrafficParams
from urbanjax.sim.replay import Replay
from urbanjax.sim.scenarios.scenario import traffic
from urbanjax.sim.signals import SignalPhases
from urbanjax.sim.world import WorldState
from urbanjax.types import VehicleState, as_arrays


def world_of(
    params: TrafficParams, *, ego: VehicleState, link: int, replay: Replay | None, signals: SignalPhases, time: float
) -> WorldState:
    """A world of recorded road users only.

    Args: params, of the traffic that there is not; ego, its state; link, that it is on; replay, the road users (None:
    nobody); signals, by their programs; time [s] of the record, and of the programs.
    """
    nobody = traffic(
        jnp.zeros(1, jnp.int32),
        jnp.zeros(1),
        speed=jnp.zeros(1),
        limit=1.0,  # of nobody: the only vehicle is not valid
        params=params,
        valid=jnp.zeros(1, bool),
    )
    return WorldState(
        ego=ego,
        ego_link=jnp.asarray(link, jnp.int32),
        traffic=nobody,
        signals=signals,
        time=as_arrays(jnp.asarray(time)),
        count=jnp.asarray(0, jnp.int32),
        replay=replay,
    )
