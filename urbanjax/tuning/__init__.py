"""What may be tuned of a closed loop, and the space in which it is."""

from urbanjax.tuning.spaces import Space, space
from urbanjax.tuning.trainable import Trainable, trainables

__all__ = ["Space", "Trainable", "space", "trainables"]
