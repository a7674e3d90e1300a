"""Which numbers of which closed loop are listed."""

from urbanjax.rollout import LoopParams
from urbanjax.types import pytree, static

KINDS = ("all", "tunable", "fixed")


@pytree
class ParameterStudy(LoopParams):
    """The closed loop, and what of it is listed."""

    pattern: str = static(default="*")  # of dotted keys, with * and ?, or the key of a group
    only: str = static(default="all", metadata={"choices": KINDS})
