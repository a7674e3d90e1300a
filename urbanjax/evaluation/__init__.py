"""What drives come to: metrics, scores, missions by the thousand; drives in the place of recorded drivers."""

from urbanjax.evaluation import statistics
from urbanjax.evaluation.metrics import Metrics, evaluate, tracks
from urbanjax.evaluation.qualify import qualify
from urbanjax.evaluation.scores import Score, ScoreParams, score, terms

__all__ = ["Metrics", "Score", "ScoreParams", "evaluate", "qualify", "score", "statistics", "terms", "tracks"]
