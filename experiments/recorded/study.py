"""Which recordings are driven in, and how."""

from collections.abc import Callable
from pathlib import Path
from typing import ClassVar

from experiments.common import recordings
from experiments.recorded.driving import Drive, drive
from urbanjax.evaluation.recorded.scenes import RecordedScene
from urbanjax.roadmap.corridor import CorridorParams
from urbanjax.rollout import LoopParams
from urbanjax.types import ConfigError, Unread, field, pytree, static

NGSIM = ("USA_US101-3_3_T-1", "USA_US101-4_1_T-1", "USA_US101-5_1_T-1", "USA_Lanker-1_1_T-1", "USA_Peach-4_8_T-1")

SIMULATED = ("sim.traffic", "sim.reaction", "sim.lane_changes")  # what recorded road users have no use for


@pytree
class RecordedStudy(LoopParams):
    """The stack in the place of every recorded driver of some CommonRoad files."""

    UNREAD: ClassVar[dict[str, Unread | None]] = {
        "shortest": Unread("a problem says itself how long it lasts, see 'egos'", lambda p: p.egos == "problems"),
        **dict.fromkeys(SIMULATED, Unread("all other road users move as they were recorded")),
    }

    corridor: CorridorParams = CorridorParams()
    shortest: float = field(default=3.0, metadata={"range": (0.2, 1e4)})  # s that a record must last
    folder: str = static(default="", metadata={"path": True})  # of the files, by default that of the data beside
    egos: str = static(default="vehicles", metadata={"choices": recordings.EGOS})
    files: tuple[str, ...] = static(default=NGSIM)  # names, with or without .xml


def paths(study: RecordedStudy) -> list[Path]:
    """The files. Raises ConfigError, naming the first one that is missing."""
    if not study.files:
        raise ConfigError("'files' names no recording")
    return recordings.paths(study.files, study.folder, key="files")


def scene_in(study: RecordedStudy, path: Path) -> RecordedScene:
    """One recording with its starts. Args: path of its file."""
    road = recordings.read(path, study.period, key="files")
    return recordings.scene_of(road, study.corridor, egos=study.egos, shortest=study.shortest, vehicle=study.vehicle)


def drives(study: RecordedStudy, path: Path, tick: Callable[[str], None]) -> tuple[RecordedScene, list[Drive]]:
    """One recording and all drives in it. Args: path of its file; tick, told what is done."""
    tick(f"{path.stem}: map and routes")
    scene = scene_in(study, path)
    tick(f"{path.stem}: {len(scene.starts)} drives")
    return scene, list(drive(study.loop(), scene))
