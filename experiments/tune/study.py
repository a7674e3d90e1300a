"""What is tuned, and from what."""

from urbanjax.rollout import LoopParams
from urbanjax.types import pytree, static

TASKS = ("closed_loop", "pareto", "imitation", "lattice", "adversary")


@pytree
class TuneStudy(LoopParams):
    """A task, and what it asks; the parameters of the loop are those that tuning starts from."""

    task: str = static(default="closed_loop", metadata={"choices": TASKS})
