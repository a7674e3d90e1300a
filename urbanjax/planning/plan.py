"""Motion planning in one call: macro plan, fan of primitives, micro plan."""

from urbanjax.numerics.soft import Relaxation
from urbanjax.planning import macro, micro, previous, primitives
from urbanjax.planning.macro import MacroPlan
from urbanjax.planning.micro import MicroPlan
from urbanjax.planning.params import PlanningParams
from urbanjax.planning.previous import Previous
from urbanjax.planning.primitives import Fan
from urbanjax.roadmap.corridor import Corridor, Progress
from urbanjax.types import Prediction, VehicleState, pytree
from urbanjax.vehicle.params import VehicleParams


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


def plan(
    window: Corridor,
    progress: Progress,
    state: VehicleState,
    prediction: Prediction,
    memory: Memory,
    vehicle: VehicleParams,
    params: PlanningParams,
    relaxation: Relaxation,
) -> Plan:
    """The macro plan over the lanes ahead (Eq. 13-15), the fan onto it (Eq. 16-21) and the choice (Eq. 22-24).

    Args: window, the lanes around the vehicle; progress, of its rear axle along them; prediction, of everybody else.
    """
    wide = macro.plan(window, progress, state, prediction, memory.macro, vehicle, params.macro, relaxation)
    fan = primitives.generate(window, progress, state, wide, vehicle, params.primitives)
    near = micro.select(fan, prediction, memory.micro, vehicle, params.micro, relaxation)
    return Plan(wide, fan, near)


def remember(made: Plan) -> Memory:
    """The plan for the next step to compare with."""
    wide, path = made.macro, made.micro.path
    return Memory(previous.remember(wide.station, wide.offset), previous.remember(path.station, path.offset))
