"""Everything that planning can be told."""

from urbanjax.planning.macro import MacroParams
from urbanjax.planning.micro import MicroParams
from urbanjax.planning.primitives import PrimitiveParams
from urbanjax.types import pytree


@pytree
class PlanningParams:
    """Macro planning, primitives and micro planning."""

    macro: MacroParams = MacroParams()
    primitives: PrimitiveParams = PrimitiveParams()
    micro: MicroParams = MicroParams()
