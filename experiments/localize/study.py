"""What the localization study is asked."""

from typing import ClassVar

from experiments.common.district import WorldParams
from experiments.localize.faults import FaultParams
from experiments.localize.loop import LoopStudy
from urbanjax.localization.lidar import LidarLocalizerParams
from urbanjax.localization.relocalize import RelocalizeParams
from urbanjax.types import POSITIVE, SEED, Unread, field, pytree, static

# What odometry on a folder has no use for, and what a map that is there already was made with.
LOCALIZER = ("sliding", "align", "health", "drift", "start", "fallback")
DRIVEN = (
    *(f"localizer.{name}" for name in LOCALIZER),
    *("search", "world", "faults", "loop", "output_rate", "give_up", "scans", "map", "seed"),
)
MAPPING = ("drive", "preprocess", "spacing", "resolution", "position_noise", "heading_noise", "reach")
MAPPED = tuple(f"world.mapping.{name}" for name in MAPPING)


@pytree
class LocalizeStudy:
    """The world, the localizer and the failures."""

    UNREAD: ClassVar[dict[str, Unread | None]] = {
        "poses": Unread("only 'folder' has scans that they may belong to", lambda p: not p.folder),
        **dict.fromkeys(DRIVEN, Unread("odometry alone runs on a 'folder'", lambda p: bool(p.folder))),
        **dict.fromkeys(
            MAPPED, Unread("the map is read from a file, see 'map'", lambda p: bool(p.map) or bool(p.folder))
        ),
    }

    localizer: LidarLocalizerParams = LidarLocalizerParams()
    search: RelocalizeParams = RelocalizeParams()
    world: WorldParams = WorldParams()
    faults: FaultParams = FaultParams()
    loop: LoopStudy = LoopStudy()
    output_rate: float = field(default=90.0, metadata=POSITIVE)  # Hz, of the poses put out between scans
    give_up: float = 100.0  # m, an error at which a method without a way back is stopped
    scans: int = static(default=0, metadata={"range": (0, 100_000)})  # of the drive, 0 for all of it
    map: str = static(default="", metadata={"path": True})  # a point-cloud map (npz) to use instead of making one
    folder: str = static(default="", metadata={"path": True})  # real scans to run odometry on, instead of the study
    poses: str = static(default="", metadata={"path": True})  # their true poses (KITTI format), if known
    seed: int = static(default=0, metadata=SEED)
