"""What the search for failures asks."""

from urbanjax.drivers import DRIVERS
from urbanjax.sim.scenarios.encounter_families import FAMILIES
from urbanjax.tuning.adversary.threat import ThreatParams
from urbanjax.types import POSITIVE, field, pytree, static


@pytree
class AdversaryTask:
    """Drivers x families of encounters x searches x seeds."""

    drivers: tuple[str, ...] = static(default=("stack", "idm"), metadata={"choices": tuple(DRIVERS)})
    families: tuple[str, ...] = static(default=tuple(FAMILIES), metadata={"choices": tuple(FAMILIES)})
    seeds: int = static(default=3, metadata={"range": (2, 100)})  # of each search
    seed: int = static(default=0, metadata={"range": (0, 2**31)})  # the first one
    budget: int = static(default=160, metadata={"range": (16, 10**6)})  # rollouts of each search
    mode: str = static(default="straight_through", metadata={"choices": ("soft", "straight_through")})  # of gradients
    temperature: float = field(default=0.3, metadata=POSITIVE)  # of the stack's choices in gradients
    drawn: int = static(default=3, metadata={"range": (0, 20)})  # of the worst found scenes
    threat: ThreatParams = ThreatParams()
