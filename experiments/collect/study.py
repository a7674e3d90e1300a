"""Which sweeps are put together, and what is best."""

from urbanjax.types import pytree, static

DIRECTIONS = ("most", "least")


@pytree
class CollectStudy:
    """Sweeps, and the scores that their jobs are compared by."""

    dirs: tuple[str, ...] = static(default=())  # of sweeps, or folders of them
    score: str = static(default="")  # a column of rows or an entry of summaries; none: see `scores.chosen`
    best: str = static(default="most", metadata={"choices": DIRECTIONS})  # of the score
    against: str = static(default="")  # a second one, for the Pareto front; "-": none
    best_against: str = static(default="most", metadata={"choices": DIRECTIONS})  # of that one
