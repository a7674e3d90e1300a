"""What may be tuned of a closed loop, and searches for it at equal cost: by gradient, and the baselines beside it."""

from urbanjax.tuning.cma_es import CmaEs
from urbanjax.tuning.gradient_descent import GradientDescent
from urbanjax.tuning.optimiser import Incumbent, Optimiser, replayed
from urbanjax.tuning.random_search import RandomSearch
from urbanjax.tuning.scenes import SceneParams
from urbanjax.tuning.search import Generation, minimise
from urbanjax.tuning.spaces import Space, space
from urbanjax.tuning.tpe import Tpe
from urbanjax.tuning.trainable import Trainable, trainables
from urbanjax.tuning.training import Training
from urbanjax.tuning.training_params import TrainingParams
from urbanjax.tuning.tune import Tuned, tune

__all__ = [
    "CmaEs",
    "Generation",
    "GradientDescent",
    "Incumbent",
    "Optimiser",
    "RandomSearch",
    "SceneParams",
    "Space",
    "Tpe",
    "Trainable",
    "Training",
    "TrainingParams",
    "Tuned",
    "minimise",
    "replayed",
    "space",
    "trainables",
    "tune",
]
