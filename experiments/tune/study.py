"""What is tuned, on what, and what it is tested on."""

from typing import ClassVar

from experiments.tune.adversary.task import AdversaryTask
from experiments.tune.imitation.task import ImitationTask
from urbanjax.evaluation.missions import MISSIONS
from urbanjax.evaluation.scores import ScoreParams
from urbanjax.evaluation.traffic import MANNERS
from urbanjax.rollout import LoopParams
from urbanjax.tuning import SceneParams, TrainingParams
from urbanjax.types import POSITIVE, Unread, field, pytree, static

SEARCHING = ("closed_loop", "pareto", "budget")
OF_RECORDS = ("imitation", "lattice")
TASKS = (*SEARCHING, "horizons", *OF_RECORDS, "adversary")
SEARCHES = ("gradient", "cma_es", "tpe", "random")
READ_BY = {  # groups, and the tasks that read them
    **dict.fromkeys(("tuned", "judged", "resume", "score"), SEARCHING),
    **dict.fromkeys(("learned", "training"), (*SEARCHING, "horizons")),
    "tested": ("closed_loop", "pareto"),
    "network": ("closed_loop",),
    "pareto": ("pareto",),
    "budget": ("budget",),
    "horizons": ("horizons",),
    "imitation": OF_RECORDS,
    "adversary": ("adversary",),
}
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
class HeldBackParams:
    """Whole drives, as deployed, of which nothing was seen while tuning."""

    missions: tuple[str, ...] = static(default=TESTED, metadata={"choices": tuple(MISSIONS), "may_be_empty": True})
    traffic: tuple[str, ...] = static(default=("idm", "non_yielding"), metadata={"choices": tuple(MANNERS)})
    seeds: int = static(default=128, metadata={"range": (1, 10**5)})  # drives of each mission in each traffic
    seed: int = static(default=5000, metadata={"range": (0, 2**31)})  # the first one


@pytree
class ParetoParams:
    """Preferences between speed and comfort."""

    points: int = static(default=8, metadata={"range": (2, 1000)})
    least: float = field(default=0.5, metadata=POSITIVE)  # comfort to speed, relative to the standard score's weights
    most: float = field(default=64.0, metadata=POSITIVE)
    taus: tuple[float, ...] = static(default=(0.0, 0.25, 0.5, 0.75, 1.0))  # of the parameters before, beside them


@pytree
class BudgetParams:
    """Searches at equal cost."""

    optimisers: tuple[str, ...] = static(default=SEARCHES, metadata={"choices": SEARCHES})
    evaluations: float = field(default=500.0, metadata=POSITIVE)  # without gradient, of each search
    apart: float = field(default=50.0, metadata=POSITIVE)  # evaluations between two looks at fresh scenes
    restarts: int = static(default=5, metadata={"range": (1, 1000)})  # each with scenes, start and seed of its own
    detuned: float = field(default=0.7, metadata=POSITIVE)  # [-], spread of where they start, in units of z


@pytree
class HorizonsParams:
    """Gradients over longer and longer horizons."""

    weights: tuple[str, ...] = static(default=("stack.planning.macro.weights.*", "stack.planning.micro.weights.*"))
    seconds: tuple[float, ...] = static(default=(1.0, 2.0, 5.0, 10.0))
    temperatures: tuple[float, ...] = static(default=(0.05, 0.1, 0.3))
    scenes: int = static(default=8, metadata={"range": (1, 1000)})


@pytree
class TuneStudy(LoopParams):
    """A task, and what it asks; the parameters of the loop are those that it begins with."""

    UNREAD: ClassVar[dict[str, Unread | None]] = {
        **{
            name: Unread(f"only {' and '.join(tasks)} do, see 'task'", lambda p, tasks=tasks: p.task not in tasks)
            for name, tasks in READ_BY.items()
        },
        **dict.fromkeys(("stack.planning.*_scale", "stack.behavior.*_scale", "sim.reaction.*_scale")),
        "stack.relaxation": Unread(
            "what is differentiated has its own, see 'training.mode' and 'training.temperatures'"
        ),
        "stack.localizer": Unread("poses are given"),
    }

    task: str = static(default="closed_loop", metadata={"choices": TASKS})
    tuned: tuple[str, ...] = static(default=TUNED)  # dotted keys with * and ?, see experiments.parameters
    network: bool = static(default=False)  # a learned cost beside the linear one is tuned too
    learned: SceneParams = SceneParams(missions=LEARNED, count=256)  # scenes to learn from
    judged: SceneParams = SceneParams(missions=JUDGED, traffic=("assertive",), count=96)  # others, to know when to stop
    tested: HeldBackParams = HeldBackParams()
    training: TrainingParams = TrainingParams()
    score: ScoreParams = ScoreParams()  # what is tuned for
    pareto: ParetoParams = ParetoParams()
    budget: BudgetParams = BudgetParams()
    horizons: HorizonsParams = HorizonsParams()
    imitation: ImitationTask = ImitationTask()
    adversary: AdversaryTask = AdversaryTask()
    resume: str = static(default="", metadata={"path": True})  # directory of a run of the same config that was cut off
