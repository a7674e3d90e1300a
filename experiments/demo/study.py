"""What a first look shows."""

from experiments.common.overtaking import OvertakeStudy
from experiments.highway.study import HighwayStudy
from urbanjax.types import pytree


@pytree
class DemoStudy:
    """The two studies, small."""

    overtake: OvertakeStudy = OvertakeStudy(starts=16)
    highway: HighwayStudy = HighwayStudy(seeds=1)
