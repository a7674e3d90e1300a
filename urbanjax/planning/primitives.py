"""Motion primitives: a fan of candidate paths from the vehicle's state onto the macro plan (Eq. 16-21)."""

import functools
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from urbanjax.geometry import polyline
from urbanjax.numerics import lean, polynomial
from urbanjax.numerics.once import once
from urbanjax.planning import shape
from urbanjax.planning.cross_section import CrossSections, cross_sections
from urbanjax.planning.macro import MacroPlan, offset_at, profile_at
from urbanjax.planning.quintic import EndState, Lateral, planar, stationwise
from urbanjax.planning.resample import arc_length_splines
from urbanjax.planning.situation import Situation
from urbanjax.types import POSITIVE, VehicleState, field, pytree, static
from urbanjax.vehicle.driving import Driving

RESAMPLINGS = ("exact", "spline")  # heading and curvature: of the quintics, or of splines through their points


@pytree
class PrimitiveParams:
    """The grid of end states, and the station grid that all candidates share."""

    PINNED: ClassVar[dict[str, str]] = {
        "min_speed": "numerics: an end state is reached in finite time",
        "low_speed": "numerics: below, quintics over time degenerate",
        "low_speed_ramp": "numerics: quintics over time degenerate at low speed",
        "*_spacing": "safety: of the points at which micro planning looks for collisions",
    }

    offsets: tuple[float, ...] = (-1.2, -0.7, -0.3, 0.0, 0.3, 0.7, 1.2)  # m beside the macro plan
    durations: tuple[float, ...] = field(default=(2.0, 3.0, 4.5), metadata=POSITIVE)  # s
    # of the free-flow speed at that time
    speed_factors: tuple[float, ...] = field(default=(0.5, 1.0), metadata={"range": (0.0, np.inf)})
    accelerations: tuple[float, ...] = (0.0,)  # m/s^2, at the end
    deceleration: float = 4.0  # m/s^2, to reach a lower end speed
    min_speed: float = 0.5  # m/s, at the end
    min_length: float = 8.0  # m, of the quintic
    return_length: float = 25.0  # m, over which a candidate goes back to the macro plan beyond its end state
    low_speed: float = 2.0  # m/s, where the lateral offset over station replaces the quintics over time
    low_speed_ramp: float = 1.0  # m/s, to either side, over which the two blend
    path_horizon: float = 6.0  # s, covered by the grid at the present speed
    min_spacing: float = field(default=1.0, metadata=POSITIVE)  # m, of the grid
    max_spacing: float = 3.0  # m
    n_points: int = static(default=41)
    resampling: str = static(default="exact", metadata={"choices": RESAMPLINGS})


@pytree
class Fan:
    """J candidates on one grid of K stations, with what the costs need to know of the road there."""

    station: Array  # [K] m along the route
    offset: Array  # [J, K] m, left positive
    position: Array  # [J, K, 2] m
    heading: Array  # [J, K] rad
    curvature: Array  # [J, K] 1/m
    time: Array  # [J, K] s, of passing each point
    speed: Array  # [J, K] m/s
    end: EndState
    follower: Array  # [B] degree to which an object follows the ego, and so does not count
    road: CrossSections  # at the K stations
    macro_offset: Array  # [K] m
    free_speed: Array  # [K] m/s


def generate(situation: Situation, driving: Driving, *, macro_plan: MacroPlan) -> Fan:
    """Candidates of offsets x accelerations x end speeds x durations, continuous in position, heading and curvature.

    Each is a quintic to its end state beside the macro plan (Eq. 16-18), and from there on the macro plan, to which the
    lateral difference decays; so all reach over the same stations and compare fairly. Below `low_speed`, where x(t)
    and y(t) degenerate, the lateral offset as a quintic of station takes over. On the grid, heading and curvature are
    those of the quintics themselves; with `resampling` "spline", of C2 splines over arc length through the points
    (Eq. 19-21), whose curvature differs by less than 0.002 1/m where it is moderate. Args: situation, of the step;
    driving, with PrimitiveParams; macro_plan, that the candidates lead onto.
    """
    window, progress, state, params = situation.window, situation.progress, situation.ego, driving.params
    spacing = state.speed * params.path_horizon / (params.n_points - 1)
    spacing = lean.clip(spacing, params.min_spacing, params.max_spacing)
    ahead = spacing * np.arange(params.n_points, dtype=spacing.dtype)
    end = end_states(state, macro_plan, params=params)
    # End states differ in station by duration and speed only.
    n, repeats = params.n_points, len(params.offsets) * len(params.accelerations)
    sampled = cross_sections(window, jnp.concatenate([progress.station + ahead, end.station[::repeats]]))
    road = jax.tree.map(lambda x: x[:n], sampled)
    at_end = jax.tree.map(lambda x: jnp.repeat(x[n:], repeats, axis=0), sampled)
    curvature = jnp.tan(state.steering) / driving.vehicle.wheelbase

    over_time = planar(state, curvature, end=end, at_end=at_end, road=road)
    over_station = stationwise(progress, state, curvature=curvature, end=end, road=road)
    ramp = lean.clip((state.speed - params.low_speed) / params.low_speed_ramp, -1.0, 1.0)
    fast = (2 + 3 * ramp - ramp**3) / 4  # from 0 at -1 to 1 at 1, level at both
    joined = jax.tree.map(lambda a, b: fast * a + (1 - fast) * b, over_time, over_station)
    beyond = continuation(macro_plan, end, station=road.station, params=params)
    inside = ahead[None, :] <= end.length[:, None]
    lateral = jax.tree.map(functools.partial(lean.where, inside), joined, beyond)
    lateral = Lateral(*once(lateral.offset, lateral.slope, lateral.bend, lateral.time, lateral.speed))

    heading, kappa = shape.to_plane(
        road.heading[None, :], road.curvature[None, :], lateral.offset, lateral.slope, lateral.bend
    )
    x, y = jnp.unstack(road.position[None], axis=-1)
    x, y = x - lateral.offset * jnp.sin(road.heading)[None, :], y + lateral.offset * jnp.cos(road.heading)[None, :]
    x, y, heading, kappa = once(x, y, heading, kappa)
    position = jnp.stack([x, y], axis=-1)
    if params.resampling == "spline":
        heading, kappa = arc_length_splines(position, heading)
    return Fan(
        station=road.station,
        offset=lateral.offset,
        position=position,
        heading=heading,
        curvature=kappa,
        time=lateral.time,
        speed=lateral.speed,
        end=end,
        follower=macro_plan.follower,
        road=road,
        macro_offset=offset_at(macro_plan, road.station)[0],
        free_speed=profile_at(macro_plan, road.station)[1],
    )


def end_states(state: VehicleState, macro_plan: MacroPlan, *, params: PrimitiveParams) -> EndState:
    """The grid of J end states beside the macro plan (Eq. 16), offsets fastest, then accelerations.

    End speeds are shares of the free-flow speed at that time, within reach of braking; the look-ahead is what uniform
    acceleration to them covers, and at least `min_length`, for which the duration is then prolonged. Args: state, of
    the ego; macro_plan, that the candidates lead onto.
    """
    dtype = state.speed.dtype
    durations, factors, accelerations, offsets = (
        jnp.asarray(v, dtype) for v in (params.durations, params.speed_factors, params.accelerations, params.offsets)
    )
    time = jnp.concatenate([jnp.zeros(1, dtype), macro_plan.time])
    free = polyline.interpolate(
        time, jnp.concatenate([macro_plan.start_speed[None], macro_plan.speed]), query=durations
    )
    reachable = state.speed - params.deceleration * durations
    speed = lean.maximum(factors[None, :] * free[:, None], lean.maximum(reachable, params.min_speed)[:, None])
    mean = (state.speed + speed) / 2
    length = lean.maximum(mean * durations[:, None], params.min_length)

    def over_offsets(x: Array) -> Array:
        return jnp.repeat(x.reshape(-1), accelerations.shape[0] * offsets.shape[0])

    station = macro_plan.start_station + over_offsets(length)
    base, slope, bend = offset_at(macro_plan, station)
    beside = jnp.tile(offsets, speed.size * accelerations.shape[0])
    return EndState(
        station=station,
        length=over_offsets(length),
        duration=over_offsets(length / mean),
        beside=beside,
        speed=over_offsets(speed),
        acceleration=jnp.tile(jnp.repeat(accelerations, offsets.shape[0]), speed.size),
        offset=base + beside,
        slope=slope,
        bend=bend,
    )


def continuation(
    macro_plan: MacroPlan, end: EndState, *, station: Float[Array, "k"], params: PrimitiveParams
) -> Lateral:
    """Beyond its end state each candidate returns to the macro plan, at its share of the free-flow speed. [J, K].

    Args: macro_plan; end [J], the end states; station [K] m, of the grid.
    """
    base, slope, bend = offset_at(macro_plan, station)
    length = params.return_length
    u = lean.clip((station[None, :] - end.station[:, None]) / length, 0.0, 1.0)
    beside = end.beside[:, None]
    time, speed = profile_at(macro_plan, station)
    end_time, end_speed = profile_at(macro_plan, end.station)
    share = (end.speed / end_speed)[:, None]
    return Lateral(
        offset=base[None, :] + beside * (1 - polynomial.smoother_step(u)),
        slope=slope[None, :] - beside * 30 * u**2 * (1 - u) ** 2 / length,
        bend=bend[None, :] - beside * 60 * u * (1 - u) * (1 - 2 * u) / length**2,
        time=end.duration[:, None] + (time[None, :] - end_time[:, None]) / share,
        speed=share * speed[None, :],
    )
