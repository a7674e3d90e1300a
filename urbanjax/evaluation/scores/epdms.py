"""The extended predictive driver model score (EPDMS) of NAVSIM 2, of windows of 4 s that were driven.

Total = product of the gates * weighted mean of the others; a gate at 0 takes everything.

| sub-score | | value |
|---|---|---|
| no at-fault collisions (NC) | gate | 0 with any (see `fault`) |
| drivable area compliance (DAC) | gate | 0 where any part of the box is outside |
| driving direction compliance (DDC) | gate | 1, 0.5 from 2 m, 0 from 6 m outside the route's direction in a second |
| traffic light compliance (TLC) | gate | 0 with a stop line crossed at red |
| ego progress (EP) | 5 | way / the larger of own way and reference, each times its gates; 1 if that is 5 m or less |
| time to collision (TTC) within bound | 5 | 0 with a collision at 0, 0.3, 0.6 or 0.9 s ahead, at constant velocity |
| lane keeping (LK) | 2 | 0 when more than 0.5 m off the route's line for 2 s on end; junctions are skipped |
| history comfort (HC) | 2 | 0 where any of nuPlan's six leaves its bounds, in the window or the 1.5 s before it |
| extended comfort (EC) | 2 | whether consecutive plans agree, told by who has plans; not defined: out of the mean |

As there, the last second holds one step more than a second has. Times to collision look at where others really will be,
and whether somebody is ahead is asked of that place, seen from where the ego is now: who runs into a moving ego from
behind counts too. Whoever is met without counting is never looked at again. Touches begin anew with each window.

What differs, because the world does:
- What is scored was driven in closed loop, not planned and tracked; others react to it, and to the reference when that
  drives. There is one stage, no follow-up scenes and weights. Hence the columns are `epdms_driven_*`.
- In evaluations windows begin every 5 s: the second between two of them counts nowhere.
- Nobody who drives here hands plans on: EC is not defined, and the weights are 14, not 16.
- No human was recorded: nothing is forgiven for having been done by one.
- The reference is this project's `pdm` in closed loop, not the one plan of theirs.
- A red light is a stop line crossed since the step before; there, the area of the connector behind it is touched.
- Outside is told from the whole outline of the box; there, from its corners. For DDC the box centre is outside when the
  margin is below half the width. In one lane is the whole box; there, a corner in a second lane is asked for.
- The way is that along the route's reference line, which moves over where the route changes lanes; so is the offset.
- In a junction is the box centre; there, for TTC, the rear axle.
- Others stand in a collision by their speed then; there, by that at the start. There are no objects (0.5 for NC).
- Accelerations are those of the rear axle, with v * yaw rate across; there, they are moved to the centre, with none
  across. Nothing is rounded. The history holds every step; there, the last one is missing.
"""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from urbanjax.evaluation.facts import Facts
from urbanjax.evaluation.metrics import HARD
from urbanjax.evaluation.scores import epdms_terms as terms
from urbanjax.evaluation.scores.epdms_terms import EpdmsParams
from urbanjax.numerics.soft import Relaxation
from urbanjax.types import pytree
from urbanjax.vehicle.params import VehicleParams


@pytree
class EpdmsSeries:
    """What the score is made of, by step of the window; what follows its end means nothing."""

    at_fault: Array  # [T] degree to which a collision at fault begins
    margin: Array  # [T] m, to the edge of the road
    against: Array  # [T] m made outside the route's direction in the last second
    ran_red: Array  # [T] bool
    way: Array  # [T] m along the route, since the start of the window
    ttc_infraction: Array  # [T] degree to which a collision within the horizon counts
    deviation: Array  # [T] m, from the route's line
    longitudinal: Array  # [T] m/s^2, smoothed, and so are the next ones
    lateral: Array  # [T] m/s^2
    jerk: Array  # [T] m/s^3, of the magnitude of the acceleration
    longitudinal_jerk: Array  # [T] m/s^3
    yaw_rate: Array  # [T] rad/s
    yaw_acceleration: Array  # [T] rad/s^2


@pytree
class EpdmsScore:
    """The score and its parts, all in [0, 1] but the last two."""

    total: Array  # []
    no_at_fault_collisions: Array  # [] gate
    drivable_area_compliance: Array  # [] gate
    driving_direction_compliance: Array  # [] gate
    traffic_light_compliance: Array  # [] gate
    gate: Array  # [] their product
    ego_progress: Array  # []
    time_to_collision_within_bound: Array  # []
    lane_keeping: Array  # []
    history_comfort: Array  # []
    extended_comfort: Array  # [] 0 where it is not defined
    extended_comfort_defined: Array  # [] 0 or 1
    gated_ego_progress: Array  # [] times the gate, and so are the next four
    gated_time_to_collision_within_bound: Array  # []
    gated_lane_keeping: Array  # []
    gated_history_comfort: Array  # []
    gated_extended_comfort: Array  # []
    way: Array  # [] m, made along the route
    reference: Array  # [] m, that of the reference, times its gates


def score(
    window: Facts,
    vehicle: VehicleParams,
    *,
    reference: Float[Array, ""],
    before: Facts | None = None,
    extended_comfort: Float[Array, ""] | None = None,
    params: EpdmsParams | None = None,
    relaxation: Relaxation = HARD,
) -> EpdmsScore:
    """The score of one window; see the table above.

    In mode soft it has a gradient through all that is continuous in the facts; lanes, junctions, red lights and the end
    of the drive stay what they are.
    Args: window [T], facts of it; vehicle, the ego's dimensions; reference [] m, the `gated_way` of the reference
    driver over the same time from the same start; before [H], facts of the steps before it, of which those alive count,
    the last ones (default: there are none); extended_comfort [] in [0, 1] (default: not defined); params, thresholds
    and weights; relaxation, hard or how soft.
    """
    params = EpdmsParams() if params is None else params
    how = {"params": params, "relaxation": relaxation}
    window = terms.begun(window)
    gates = terms.gates(window, terms.faults(window, vehicle, **how), **how)
    gate, made = jnp.prod(jnp.stack(list(gates.values()))), terms.way(window)
    infractions = terms.infractions(window, vehicle, **how)
    defined = jnp.full_like(gate, extended_comfort is not None)
    extended = jnp.asarray(0 if extended_comfort is None else extended_comfort, gate.dtype)
    weighted = {
        "ego_progress": (params.progress_weight, terms.progress(made, gate, reference=reference, **how)),
        "time_to_collision_within_bound": (params.ttc_weight, jnp.prod(1 - jnp.sum(infractions, axis=0))),
        "lane_keeping": (params.lane_keeping_weight, terms.lane_keeping(window, params, relaxation=relaxation)),
        "history_comfort": (params.history_comfort_weight, terms.history_comfort(window, before, **how)),
        "extended_comfort": (params.extended_comfort_weight * defined, extended),
    }
    weights = jnp.stack([jnp.asarray(weight, gate.dtype) for weight, _ in weighted.values()])
    gated = {f"gated_{name}": gate * part for name, (_, part) in weighted.items()}
    return EpdmsScore(
        total=jnp.sum(weights * jnp.stack(list(gated.values()))) / jnp.sum(weights),
        **gates,
        gate=gate,
        **{name: part for name, (_, part) in weighted.items()},
        extended_comfort_defined=defined,
        **gated,
        way=made,
        reference=jnp.asarray(reference, gate.dtype),
    )


def gated_way(
    window: Facts, vehicle: VehicleParams, *, params: EpdmsParams | None = None, relaxation: Relaxation = HARD
) -> Float[Array, ""]:
    """The way [] m made along the route in a window, times its gates: what a reference driver is asked for.

    Args: window [T], facts of it; vehicle, the ego's dimensions; params, thresholds; relaxation, hard or how soft.
    """
    params = EpdmsParams() if params is None else params
    how = {"params": params, "relaxation": relaxation}
    window = terms.begun(window)
    gates = terms.gates(window, terms.faults(window, vehicle, **how), **how)
    return terms.way(window) * jnp.prod(jnp.stack(list(gates.values())))


def series(
    window: Facts,
    vehicle: VehicleParams,
    *,
    before: Facts | None = None,
    params: EpdmsParams | None = None,
    relaxation: Relaxation = HARD,
) -> EpdmsSeries:
    """What the score is made of, step by step.

    Args: window [T], facts of it; vehicle, the ego's dimensions; before [H], facts of the steps before it, see `score`;
    params, thresholds; relaxation, hard or how soft.
    """
    params = EpdmsParams() if params is None else params
    how = {"params": params, "relaxation": relaxation}
    window = terms.begun(window)
    blamed, infractions = terms.faults(window, vehicle, **how), terms.infractions(window, vehicle, **how)
    felt, earlier, _ = terms.felt(window, before)
    steps = window.time.shape[0]
    return EpdmsSeries(
        at_fault=1 - jnp.prod(1 - blamed.at_fault, axis=1),
        margin=window.road_margin,
        against=terms.against(window, params),
        ran_red=window.ran_red,
        way=window.station - window.station[0],
        ttc_infraction=1 - jnp.prod(1 - infractions, axis=1),
        deviation=jnp.abs(window.offset),
        **{
            name: jax.lax.dynamic_slice_in_dim(getattr(felt, name), earlier, steps)
            for name in felt.__dataclass_fields__
        },
    )
