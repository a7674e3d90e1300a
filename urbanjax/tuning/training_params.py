"""How a closed loop is tuned."""

import numpy as np

from urbanjax.tuning.losses.closed_loop import DERIVATIVES, SEGMENT
from urbanjax.types import INSIDE, POSITIVE, SEED, SHARE, ConfigError, field, pytree, static

OPTIMISERS = ("gradient", "cma_es", "tpe", "random")
POSITIVE_SHARE = {"range": (INSIDE["range"][0], 1.0)}


@pytree
class TrainingParams:
    """Of the search, of its gradients, and of when it ends."""

    optimiser: str = static(default="gradient", metadata={"choices": OPTIMISERS})
    generations: int = static(default=60, metadata={"range": (1, 10**6)})  # at most
    scenes: int = static(default=16, metadata={"range": (1, 10**4)})  # of a generation, the same for all its points
    restarts: int = static(default=1, metadata={"range": (1, 1000)})  # points that descend at the same time
    sigma: float = field(default=0.3, metadata=POSITIVE)  # [-], spread of first points, in units of z
    rate: float = field(default=0.05, metadata=POSITIVE)  # [-], of a step in z; falls to 0 as a cosine
    clip: float = field(default=1.0, metadata=POSITIVE)  # [-], greatest norm of a gradient
    scene_clip: float = field(default=1.0, metadata=POSITIVE)  # [-], greatest norm of that of one scene
    step_clip: float = field(default=10.0, metadata=POSITIVE)  # [-], greatest norm of what a step hands back
    risk: float = field(default=1.0, metadata=POSITIVE_SHARE)  # share of the worst scenes that count; 1: all do
    mode: str = static(default="soft", metadata={"choices": ("soft", "straight_through")})  # of what is differentiated
    temperatures: tuple[float, ...] = field(default=(0.1, 0.05), metadata=POSITIVE)  # of the first and last generation
    derivative: str = static(default="auto", metadata={"choices": DERIVATIVES[:-1]})
    horizons: tuple[float, ...] = field(default=(2.0, 4.0), metadata=POSITIVE)  # s, the next as long as gradients hold
    least_cosine: float = field(default=0.5, metadata=SHARE)  # [-] to an evolution strategy's gradient: they hold
    every: int = static(default=5, metadata={"range": (1, 10**6)})  # generations between two validations
    patience: int = static(default=4, metadata={"range": (1, 10**6)})  # validations without a better one, then it ends
    seed: int = static(default=0, metadata=SEED)

    def temperature(self, generation: int) -> float:
        """Of the choices in a generation: it falls, or rises, as a geometric series. Args: generation, from 0."""
        first, last = float(self.temperatures[0]), float(self.temperatures[-1])
        share = min(generation / max(self.generations - 1, 1), 1.0)
        return first * (last / first) ** share

    def steps(self, period: float) -> tuple[int, ...]:
        """Steps of each horizon, multiples of SEGMENT. Args: period [s], of a step. Raises ConfigError for too few."""
        found = tuple(SEGMENT * round(float(horizon) / period / SEGMENT) for horizon in self.horizons)
        if not found or found[0] < SEGMENT or np.any(np.diff(found) <= 0):
            told = ", ".join(f"{float(horizon):g}" for horizon in self.horizons)
            raise ConfigError(
                f"'horizons' is [{told}]: give one or more, each longer, by steps of {SEGMENT * period:g} s"
            )
        return found
