"""Maximum-entropy imitation over the candidates of the micro plan: how likely a driver's choice is under its costs.

P(j) = softmax(-cost_j / T). Scale of the weights and temperature T are a gauge: only weights / T is in the likelihood.
The scale is what MicroWeights pins, `length` = 1 (so that all weights stay metres of way), and T is free: it says by
how many metres of cost a driver is indifferent, and each set of weights is judged at its own best one.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.evaluation.recorded.demonstration import Demonstration
from urbanjax.numerics import safe
from urbanjax.planning import macro, micro, plan, primitives
from urbanjax.planning.costs import curvature, parts, segments
from urbanjax.planning.learned import context_of
from urbanjax.planning.micro import MICRO_TERMS, UNIT
from urbanjax.planning.params import PlanningParams
from urbanjax.planning.primitives import Fan
from urbanjax.types import pytree
from urbanjax.vehicle.driving import Driving
from urbanjax.vehicle.params import VehicleParams


@pytree
class Choices:
    """J candidates of one demonstration, as far as their costs and the driver tell them apart."""

    features: Array  # [J, C] cost terms by MICRO_TERMS at weights of 1
    broken: Array  # [J] m, price of the limits that a candidate breaks: pinned, whatever the weights
    context: Array  # [X] of the scene, see `planning.learned.CONTEXT`
    error: Array  # [J, H] m, between the centres of candidate and driver at equal times
    printed: Array  # [J] m, cost as the paper prints it, see `printed_cost`


def choices(demonstration: Demonstration, driving: Driving, *, n_times: int) -> Choices:
    """What the fan offered where a driver chose; nothing is remembered of a step before, so that transition is 0.

    Differentiable with respect to all continuous params of macro plan and primitives, but through hard choices.
    Args: demonstration, one; driving, with PlanningParams, whose vehicle the demonstration's takes the place of;
    n_times, H, the first of its times that count.
    """
    driving = driving.replace(vehicle=demonstration.vehicle)
    fan, memory = fan_of(demonstration, driving), plan.nothing(driving.params)
    own = driving.of(driving.params.micro.replace(weights=UNIT))
    room = micro.clearance(fan, own, prediction=demonstration.situation.prediction)
    features, margins = micro.judged(fan, own, room=room, previous=memory.micro)
    broken = driving.params.micro.infeasible * jnp.sum(margins < 0, axis=1)
    places = positions_at(fan, demonstration.time[:n_times], vehicle=driving.vehicle)
    error = safe.norm(places - demonstration.position[None, :n_times])
    return Choices(
        features, broken.astype(error.dtype), context_of(fan, room=room), error, printed_cost(fan, room=room)
    )


def printed_cost(fan: Fan, *, room: Float[Array, "j k"]) -> Float[Array, "j"]:
    """Cost [J] of Eq. 22-24 as printed, every weight 1: length, plus distance to obstacles, plus curvature.

    The distance counts for a cost, which rewards nearness to obstacles; the transition is 0 without a plan before.
    Args: fan, of candidates; room [J, K] m, clearance at each point.
    """
    step = segments(fan.position)
    return jnp.sum(step + parts(room, step) + curvature(fan.curvature, step), axis=1)


def fan_of(demonstration: Demonstration, driving: Driving) -> Fan:
    """The candidates that the stack would have there. Args: demonstration, one; driving, with PlanningParams."""
    params: PlanningParams = driving.params
    situation, memory = demonstration.situation, plan.nothing(params)
    macro_plan = macro.plan(situation, driving.of(params.macro), previous=memory.macro)
    return primitives.generate(situation, driving.of(params.primitives), macro_plan=macro_plan)


def positions_at(fan: Fan, time: Float[Array, "h"], *, vehicle: VehicleParams) -> Float[Array, "j h 2"]:
    """Centres [J, H, 2] (m) of the ego's box at some times, along each candidate at its own assumed speed.

    Past the end of the grid a candidate goes straight on at its last speed. Args: fan, of J candidates; time [H] s;
    vehicle, for the way from the rear axle to the centre.
    """

    def each(position: Array, heading: Array, passed: Array, speed: Array) -> Array:
        cos, sin = jnp.cos(heading), jnp.sin(heading)
        towards = jnp.stack([cos, sin], axis=-1)
        centre = position + vehicle.centre_offset * towards
        at = jnp.stack([jnp.interp(time, passed, x) for x in jnp.unstack(centre, axis=-1)], axis=-1)
        beyond = jnp.maximum(time - passed[-1], 0) * speed[-1]
        return at + beyond[:, None] * towards[None, -1]

    return jax.vmap(each)(fan.position, fan.heading, fan.time, fan.speed)


def costs(choices: Choices, weights: Any, *, learned: Any = None) -> Float[Array, "j"]:
    """Cost [J] (m) of each candidate, as micro planning has it in mode hard.

    Args: choices, of one demonstration; weights, a MicroWeights; learned, a LearnedCost (None: there is none).
    """
    scale = jnp.stack([jnp.asarray(getattr(weights, name), choices.features.dtype) for name in MICRO_TERMS])
    linear = jnp.sum(choices.features * scale[None, :], axis=1) + choices.broken
    return linear if learned is None else linear + learned(choices.features, choices.context)


def log_probability(cost: Float[Array, "j"], temperature: float | Float[Array, ""]) -> Float[Array, "j"]:
    """Log of the share [J] in which each candidate is chosen. Args: cost [J] m; temperature [] m."""
    return jax.nn.log_softmax(-cost / temperature)


def nearest_candidate(choices: Choices) -> Array:
    """The candidate nearest to the driver: least mean distance at equal times, of those that break fewest limits.

    Where the nearest of all breaks a limit the driver did what the stack may not do: no weight explains that, and its
    price would be taken for indifference (a higher temperature). Args: choices, of one demonstration.
    """
    allowed = choices.broken <= jnp.min(choices.broken)
    return jnp.argmin(jnp.where(allowed, jnp.mean(choices.error, axis=1), jnp.inf))


def nearest_loss(choices: Choices, cost: Float[Array, "j"], *, temperature: float | Float[Array, ""]) -> Array:
    """-log P of the candidate nearest to the driver [nat].

    Args: choices, of one demonstration; cost [J] m; temperature [] m.
    """
    return -log_probability(cost, temperature)[nearest_candidate(choices)]


def driven_loss(
    choices: Choices, cost: Float[Array, "j"], *, temperature: float | Float[Array, ""], spread: float | Array
) -> Array:
    """-log of what the driver did under a mixture of the candidates [nat]: each is driven with some spread around it.

    sum_j P_j exp(-d_j^2 / (2 s^2)) / (s sqrt(2 pi))^2, with d the root mean square distance over time. Unlike
    `nearest_loss` it has a derivative by the fan itself, so that where candidates lie and how fast they are can be
    tuned; at a spread well below the distance of candidates both favour the same weights. Args: choices, of one
    demonstration; cost [J] m; temperature [] m; spread s [] m, of a driver around a candidate.
    """
    squared = jnp.mean(choices.error**2, axis=1)
    fits = -squared / (2 * spread**2) - jnp.log(2 * jnp.pi * spread**2)
    return -jax.nn.logsumexp(log_probability(cost, temperature) + fits)


def displacement(choices: Choices, cost: Float[Array, "j"], *, temperature: float | Float[Array, ""]) -> Array:
    """Expected distance from the driver at the last time [m]: of final displacement the soft twin.

    Where likelihood is honest about what remains open, this asks for the one best choice; T tends to 0. Args: choices,
    of one demonstration; cost [J] m; temperature [] m.
    """
    return jnp.sum(jnp.exp(log_probability(cost, temperature)) * choices.error[:, -1])
