"""Which recorded drivers are imitated, and how."""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from experiments.common import recordings
from urbanjax.evaluation.recorded import moments
from urbanjax.evaluation.recorded.demonstration import Demonstration
from urbanjax.io import maps
from urbanjax.numerics.compiling import compiler_options
from urbanjax.roadmap.corridor import CorridorParams
from urbanjax.rollout import LoopParams
from urbanjax.tuning.losses import imitation
from urbanjax.tuning.losses.imitation import Choices
from urbanjax.types import (
    POSITIVE,
    SEED,
    ConfigError,
    RouteError,
    as_arrays,
    field,
    host_record,
    pytree,
    static,
    with_values,
)

# Recordings of people; OSC_CutIn and ZAM_Zip are made up.
DRIVEN = (
    "C-DEU_MONAMerge-2_1_T-299",
    "USA_Lanker-1_1_T-1",
    "USA_Peach-4_8_T-1",
    "USA_US101-3_3_T-1",
    "USA_US101-4_1_T-1",
    "USA_US101-5_1_T-1",
)
HORIZON = 3.0  # s
N_TIMES = round(HORIZON / moments.SPACING)
AT_ONCE = 16  # demonstrations that are planned for at once
COUNT = {"range": (1, 100_000)}


@pytree
class ImitationTask:
    """Recorded drivers, the fan that they choose from, and how long it is searched."""

    corridor: CorridorParams = CorridorParams()
    apart: float = field(default=1.0, metadata=POSITIVE)  # s, between two moments of a driver
    # Of the free-flow speed, in place of the deployed 0.5 and 1: hardly anybody drives just those.
    speed_factors: tuple[float, ...] = field(default=(0.0, 0.5, 0.8, 1.0, 1.2), metadata={"range": (0, 3)})
    spread: float = field(default=0.7, metadata=POSITIVE)  # m, of a driver around the candidate that it follows
    prior: float = field(default=1e-3, metadata=POSITIVE)  # nat per squared unit of z: what nothing informs stays
    folder: str = static(default="", metadata={"path": True})  # of the files, by default that of the data beside
    files: tuple[str, ...] = static(default=DRIVEN)  # names, with or without .xml
    steps: int = static(default=400, metadata=COUNT)  # of a search over weights
    fan_steps: int = static(default=72, metadata=COUNT)  # of one through the planner
    batch: int = static(default=48, metadata=COUNT)  # demonstrations of each of those
    network_steps: int = static(default=300, metadata=COUNT)
    planted: int = static(default=400, metadata=COUNT)  # choices of a driver with known weights
    seed: int = static(default=0, metadata=SEED)


@host_record
class RecordedDrivers:
    """N demonstrations of all files."""

    file: np.ndarray  # [N] str
    driver: np.ndarray  # [N] str
    every: Demonstration  # [N, ...]
    left_out: dict[str, str]  # file or vehicle -> why

    @property
    def files(self) -> list[str]:
        """Of which there are demonstrations."""
        return list(dict.fromkeys(self.file.tolist()))

    @property
    def driven(self) -> np.ndarray:
        """Where they were [N, H, 2] m, up to the horizon."""
        return np.asarray(self.every.position[:, :N_TIMES])


def drivers(task: ImitationTask, loop: LoopParams, tick: Callable[[str], None]) -> RecordedDrivers:
    """All demonstrations. Raises ConfigError where a file is missing, or fewer than two have any.

    Args: task; loop, whose stack sees the situations; tick, told what is done.
    """
    found, left_out = [], {}
    for path in recordings.paths(task.files, task.folder, key="imitation.files"):
        tick(f"{path.stem}: what its drivers saw")
        road = maps.read(path)
        if road.recording is None:
            raise ConfigError(f"{path} holds no recorded traffic: choose other 'imitation.files'")
        least = HORIZON + moments.LEAST_HISTORY
        try:
            scene = recordings.scene_of(
                road, task.corridor, egos="vehicles", shortest=least, vehicle=as_arrays(loop.vehicle)
            )
        except RouteError as error:
            left_out[path.stem] = str(error)
            continue
        left_out |= {f"{scene.name} {name}": why for name, why in scene.left_out.items()}
        found.append(moments.demonstrations(loop, scene, future=HORIZON, apart=float(task.apart)))
    if len(found) < 2:
        raise ConfigError("'imitation.files' has fewer than two files with drivers: one is left out to test on")
    return RecordedDrivers(
        file=np.concatenate([[one.scene] * len(one.driver) for one in found]),
        driver=np.concatenate([one.driver for one in found]),
        every=jax.tree.map(lambda *x: np.concatenate(x), *[one.every for one in found]),
        left_out=left_out,
    )


def with_fan(loop: LoopParams, task: ImitationTask) -> LoopParams:
    """The loop with the fan that drivers are compared with."""
    return with_values(loop, {"stack.planning.primitives.speed_factors": tuple(map(float, task.speed_factors))})


def chosen_from(loop: LoopParams, every: Demonstration) -> Choices:
    """What the fan offers at each demonstration [N, ...], on the host."""
    return jax.device_get(_choices(as_arrays(loop).handed_down()[0], every))


def _all_choices(stack: Any, every: Demonstration) -> Choices:
    def one(demonstration: Demonstration) -> Choices:
        return imitation.choices(demonstration, stack.driving(stack.planning), n_times=N_TIMES)

    return jax.lax.map(one, every, batch_size=AT_ONCE)


_choices = jax.jit(_all_choices, compiler_options=compiler_options())
