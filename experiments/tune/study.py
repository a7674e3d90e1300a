"""What is tuned, on what, and what it is tested on."""

from urbanjax.evaluation.missions import MISSIONS
from urbanjax.evaluation.traffic import MANNERS
from urbanjax.rollout import LoopParams
from urbanjax.tuning import SceneParams, TrainingParams
from urbanjax.types import pytree, static

TASKS = ("closed_loop",)
TUNED = (
    "stack.planning.macro.weights.*",
    "stack.planning.micro.weights.*",
    "stack.behavior.*",
)
LEARNED = (
    "overtake",
    "accident_vehicle",
    "unsignalised",
    "signal_left",
    "lane_drop",
    "oncoming_overtake",
    "tight_right",
)
JUDGED = ("cut_in", "signal_right", "double_parked")
TESTED = ("narrow_passage", "signal_straight", "congestion", "roundabout")


@pytree
class TestParams:
    """Whole drives, as deployed, of which nothing was seen while tuning."""

    missions: tuple[str, ...] = static(default=TESTED, metadata={"choices": tuple(MISSIONS), "may_be_empty": True})
    traffic: tuple[str, ...] = static(default=("idm", "non_yielding"), metadata={"choices": tuple(MANNERS)})
    seeds: int = static(default=128, metadata={"range": (1, 10**5)})  # drives of each mission in each traffic
    seed: int = static(default=5000, metadata={"range": (0, 2**31)})  # the first one


@pytree
class TuneStudy(LoopParams):
    """A task, and what it asks; the parameters of the loop are those that it begins with."""

    task: str = static(default="closed_loop", metadata={"choices": TASKS})
    tuned: tuple[str, ...] = static(default=TUNED)  # dotted keys with * and ?, see experiments.parameters
    learned: SceneParams = SceneParams(missions=LEARNED, count=256)  # scenes to learn from
    judged: SceneParams = SceneParams(missions=JUDGED, traffic=("assertive",), count=96)  # others, to know when to stop
    tested: TestParams = TestParams()
    training: TrainingParams = TrainingParams()
    resume: str = static(default="", metadata={"path": True})  # directory of a run of the same config that was cut off
