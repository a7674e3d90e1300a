"""Motion planning in one call: macro plan, fan of primitives, micro plan."""

import jax

from urbanjax.planning import macro, micro, previous, primitives
from urbanjax.planning.macro import MacroPlan
from urbanjax.planning.micro import MicroPlan
from urbanjax.planning.params import PlanningParams
from urbanjax.planning.previous import Previous
from urbanjax.planning.primitives import Fan
from urbanjax.planning.situation import Situation
from urbanjax.types import pytree
from urbanjax.vehicle.driving import Driving


@pytree
class Plan:
    """What each stage came to."""

    macro: MacroPlan
    fan: Fan
    micro: MicroPlan


@pytree
class Memory:
    """The plans of the step before, against which transitions are judged."""

    macro: Previous
    micro: Previous


def nothing(params: PlanningParams) -> Memory:
    """What a first step remembers."""
    return Memory(previous.nothing(params.macro.n_layers), previous.nothing(params.primitives.n_points))


def plan(situation: Situation, driving: Driving, *, memory: Memory) -> Plan:
    """The macro plan over the lanes ahead (Eq. 13-15), the fan onto it (Eq. 16-21) and the choice (Eq. 22-24).

    Args: situation, of the step; driving, with PlanningParams; memory, of the step before.
    """
    params = driving.params
    with jax.named_scope("macro"):
        macro_plan = macro.plan(situation, driving.of(params.macro), previous=memory.macro)
    with jax.named_scope("primitives"):
        fan = primitives.generate(situation, driving.of(params.primitives), macro_plan=macro_plan)
    with jax.named_scope("micro"):
        prediction = situation.prediction
        micro_plan = micro.select(fan, driving.of(params.micro), prediction=prediction, previous=memory.micro)
    return Plan(macro_plan, fan, micro_plan)


def remember(made: Plan) -> Memory:
    """The plan for the next step to compare with. Args: made, in this step."""
    macro_plan, path = made.macro, made.micro.path
    return Memory(
        previous.remember(macro_plan.station, macro_plan.offset), previous.remember(path.station, path.offset)
    )
