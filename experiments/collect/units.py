"""Units and bounds of what may be varied, as the fields themselves state them."""

import functools
from collections.abc import Mapping

from urbanjax.rollout import LoopParams
from urbanjax.tuning.trainable import Trainable, trainables

NO_UNIT = "[-]"


@functools.cache
def known_numbers() -> Mapping[str, Trainable]:
    """The continuous numbers of a closed loop by dotted key; of a tuple its last element."""
    return {number.field: number for number in trainables(LoopParams())}
