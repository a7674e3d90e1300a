"""Parameters of the study of registration."""

from typing import ClassVar

from experiments.register.calibration import CalibrationParams
from experiments.register.factorial import FactorialParams
from experiments.register.pair import PairParams
from experiments.register.rows import RowsParams
from experiments.register.stretch import StretchParams
from urbanjax.localization.lidar import LidarLocalizerParams
from urbanjax.types import SEED, Unread, pytree, static

# Parts of the localizer that nothing here is about.
LOCATED = tuple(f"localizer.{name}" for name in ("odometry", "health", "drift", "start", "fallback"))


@pytree
class RegisterStudy:
    """The world, what is registered on it, and what counts as success."""

    UNREAD: ClassVar[dict[str, Unread | None]] = {
        **dict.fromkeys(LOCATED, Unread("scans are registered one by one, with nothing carried from one to the next")),
        "world.mapping.distributions": Unread("the rows of Table I and 'factorial' say them"),
        "pair.speed.points": Unread("the pair has the points that it has"),
    }

    world: StretchParams = StretchParams()
    localizer: LidarLocalizerParams = LidarLocalizerParams()  # how scans are prepared, and what Table I leaves open
    rows: RowsParams = RowsParams()
    factorial: FactorialParams = FactorialParams()
    calibration: CalibrationParams = CalibrationParams()
    pair: PairParams = PairParams()
    lost: float = 0.5  # m, planar error above which a pose is wrong
    neighbours: int = static(default=7, metadata={"choices": (1, 7, 27)})  # voxels that a point may belong to
    seed: int = static(default=0, metadata=SEED)
