"""What the localization study is asked."""

from experiments.common.district import WorldParams
from experiments.localize.faults import FaultParams
from experiments.localize.loop import LoopStudy
from urbanjax.localization.lidar import LidarLocalizerParams
from urbanjax.localization.relocalize import RelocalizeParams
from urbanjax.types import POSITIVE, field, pytree, static


@pytree
class LocalizeStudy:
    """The world, the localizer and the failures."""

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
    seed: int = static(default=0)
