"""Which moments of which drives a closed loop is tuned on (host side)."""

from collections.abc import Sequence

import numpy as np

from urbanjax.evaluation.missions import MISSIONS
from urbanjax.evaluation.missions.mission import ROADS
from urbanjax.types import ConfigError, field, host_record, pytree, static

APART = 2.5  # s, between the moments of a drive at which a scene may begin
TRAFFIC = ("idm", "mixed", "assertive", "non_yielding")  # all but replayed traffic, which knows nothing of the ego
QUOTIENTS = 10**6  # of seeds by the number of roads, from which they are drawn


@pytree
class SceneParams:
    """A set of scenes. Two of them with other missions, other traffic or other roads have no drive in common."""

    missions: tuple[str, ...] = static(default=("overtake",), metadata={"choices": tuple(MISSIONS)})
    traffic: tuple[str, ...] = static(default=("idm", "mixed"), metadata={"choices": TRAFFIC})
    roads: tuple[int, ...] = static(default=tuple(range(12)), metadata={"range": (0, ROADS - 1)})  # of each mission
    count: int = static(default=64, metadata={"range": (1, 10**5)})  # scenes
    latest: float = field(default=10.0, metadata={"range": (0.0, 30.0)})  # s after the start of a drive


@host_record
class TuningScene:
    """A drive, and the moment from which on it is scored."""

    mission: str
    seed: int  # of its drive
    traffic: str
    moment: float  # s after the start of the drive

    @property
    def road(self) -> str:
        """The name of its road."""
        return f"{self.mission} {self.seed % ROADS}"

    def __str__(self) -> str:
        return f"{self.mission}, seed {self.seed}, {self.traffic} traffic, {self.moment:g} s after the start"


def scenes(params: SceneParams, *, seed: int) -> tuple[TuningScene, ...]:
    """Scenes of all the missions in turn; traffic, seed, road and moment of each are drawn.

    Args: seed, of what is drawn. Raises ConfigError for missions of which no one program holds all.
    """
    first, *others = params.missions
    for name in others:
        if MISSIONS[name].size != MISSIONS[first].size:
            raise ConfigError(f"'missions': {first} and {name} differ in size, and no program holds both")
    rng = np.random.default_rng(seed)
    last = int(float(params.latest) / APART + 1e-6)

    def one(names: Sequence) -> int:
        return int(rng.integers(len(names)))

    return tuple(
        TuningScene(
            mission=params.missions[k % len(params.missions)],
            seed=int(rng.integers(QUOTIENTS)) * ROADS + params.roads[one(params.roads)],
            traffic=params.traffic[one(params.traffic)],
            moment=APART * int(rng.integers(last + 1)),
        )
        for k in range(params.count)
    )
