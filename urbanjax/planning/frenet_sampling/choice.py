"""What candidate trajectories of a Frenet grid cost, and which one is taken."""

import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import Float

from urbanjax.numerics import safe, soft
from urbanjax.planning.frenet_sampling.fan import FIELDS, FrenetFan, generate
from urbanjax.planning.frenet_sampling.limits import FrenetLimits, broken
from urbanjax.planning.frenet_sampling.line import ReferenceLine
from urbanjax.planning.frenet_sampling.motion import EndGrid, FrenetState
from urbanjax.types import Prediction, pytree
from urbanjax.vehicle.driving import Driving

FRENET_TERMS = ("lateral_jerk", "longitudinal_jerk", "speed", "offset")


@pytree
class FrenetWeights:
    """Weight of each of FRENET_TERMS."""

    lateral_jerk: float = 0.2  # per m/s^2.5
    longitudinal_jerk: float = 0.2  # per m/s^2.5
    speed: float = 1.0  # per m/s^0.5
    offset: float = 2.0  # per m s^0.5


@pytree
class FrenetParams:
    """The grid, what its candidates pay, and what makes them infeasible."""

    grid: EndGrid = EndGrid()
    weights: FrenetWeights = FrenetWeights()
    limits: FrenetLimits = FrenetLimits()
    jerk_time: float = 100.0  # s (or m across the line at low speed), over which jerk counts at most
    infeasible: float = 1e3  # cost of each limit that is broken
    choice_scale: float = 1.0  # of cost that counts as clearly cheaper


@pytree
class FrenetPlan:
    """The chosen trajectory, and all that led to the choice; arrays over candidates are [D, V * A, N]."""

    values: Array  # [6, T] of the choice, by FIELDS
    terms: Array  # [C, D, V * A, N] weighted cost by FRENET_TERMS
    cost: Array  # [D, V * A, N] their sum, and the penalties of broken limits
    reasons: Array  # [R, D, V * A, N] bool, limits of FRENET_LIMITS that a candidate breaks
    chosen: Array  # [] int, among all candidates in their order
    feasible: Array  # [] bool, the choice breaks no limit


def plan(
    line: ReferenceLine,
    state: FrenetState,
    *,
    desired_speed: Float[Array, ""],
    prediction: Prediction | None,
    driving: Driving,
) -> FrenetPlan:
    """The cheapest candidate that breaks no limit, or the least bad one where all do.

    In mode hard the choice is piecewise constant; in soft its trajectory is the mean by softmin weights. Whether limits
    are broken is a hard question in both. Args: line, the reference; state, of the vehicle in its Frenet frame;
    desired_speed [] m/s; prediction, of everybody else, None if collisions do not count; driving, with FrenetParams.
    """
    params, relaxation = driving.params, driving.relaxation
    fan = generate(line, state, grid=params.grid)
    terms = weighted_terms(fan, desired_speed, params=params)
    reasons = broken(fan, prediction, vehicle=driving.vehicle, grid=params.grid, limits=params.limits)
    terms, reasons = lax.optimization_barrier((terms, reasons))  # else all that terms are made of is summed anew
    cost = jnp.sum(terms, axis=0) + params.infeasible * jnp.sum(reasons, axis=0)
    flat, values = cost.reshape(-1), fan.values.reshape(len(FIELDS), -1, fan.values.shape[-1])
    chosen = jnp.argmin(flat)
    if relaxation.mode == "hard":
        taken = _candidate(fan.values, chosen)
    else:
        taken = jnp.einsum(
            "j,fjt->ft", soft.choose(flat, relaxation, scale=params.choice_scale), values, precision="highest"
        )
    feasible = ~jnp.any(reasons.reshape(reasons.shape[0], -1)[:, chosen])
    return FrenetPlan(taken, terms, cost, reasons, chosen, feasible)


def _candidate(values: Float[Array, "f d v n t"], which: Array) -> Float[Array, "f t"]:
    """One candidate, cut from the array as it lies in memory: else the slice counts as all of it, and wakes threads."""
    *_, v, n, t = values.shape
    place = which // (v * n), which // n % v, which % n * t
    rows = values.reshape(*values.shape[:3], n * t)
    return lax.dynamic_slice(rows, (0, *place), (values.shape[0], 1, 1, t)).reshape(-1, t)


def plans(
    lines: ReferenceLine,
    states: FrenetState,
    *,
    desired_speeds: Float[Array, "s"],
    predictions: Prediction | None,
    driving: Driving,
    at_once: int = 1,
) -> FrenetPlan:
    """The plans of S scenarios, stacked along the first axis.

    Args: lines, states, desired_speeds [S] m/s and predictions, those of `plan`, stacked; driving, with FrenetParams,
    the same for all; at_once, how many are planned together: 1 on a CPU, where one fan fits into its caches and many do
    not, many on a GPU.
    """

    def one(scenario: tuple) -> FrenetPlan:
        line, state, desired_speed, prediction = scenario
        return plan(line, state, desired_speed=desired_speed, prediction=prediction, driving=driving)

    scenarios = (lines, states, desired_speeds, predictions)
    return lax.map(one, scenarios, batch_size=None if at_once == 1 else at_once)


def weighted_terms(fan: FrenetFan, desired_speed: Float[Array, ""], *, params: FrenetParams) -> Float[Array, "c d v n"]:
    """Weighted cost [C, D, V * A, N] by FRENET_TERMS, each the root of an integral of squares over time.

    Jerk in closed form, up to the end of the motion; the squared distance from the desired speed over all points; that
    from the reference line over the second half of them. Args: fan, of candidates; desired_speed [] m/s.
    """
    grid, weights, shape = params.grid, params.weights, fan.speed.shape[:-1]
    durations = jnp.asarray(grid.durations, fan.values.dtype)[None]
    along = (*fan.along.jerk, jnp.zeros_like(durations))
    longitudinal = jerk_integral(along, jnp.minimum(params.jerk_time, durations))[None]
    lateral = jerk_integral(fan.across.jerk, jnp.minimum(params.jerk_time, fan.across.length))
    missing = fan.speed - desired_speed
    aside = fan.across.offset[..., grid.n_times - grid.n_times // 2 :]
    squares = (
        (weights.lateral_jerk, lateral),
        (weights.longitudinal_jerk, longitudinal),
        (weights.speed, grid.period * jnp.sum(missing * missing, axis=-1)),
        (weights.offset, grid.period * jnp.sum(aside * aside, axis=-1)),
    )
    return jnp.stack([jnp.broadcast_to(weight * safe.sqrt(value), shape) for weight, value in squares])


def jerk_integral(jerk: tuple[Array, Array, Array], time: Array) -> Array:
    """Integral of (j + k t + l t^2)^2 from 0 to `time`.

    Args: jerk, the coefficients j, k, l; time, the end, s (or m, as in Across), of shapes that broadcast.
    """
    j, k, l = jerk  # noqa: E741
    t = time
    return t * (j * j + t * (j * k + t * ((k * k + 2 * j * l) / 3 + t * (k * l / 2 + t * l * l / 5))))
