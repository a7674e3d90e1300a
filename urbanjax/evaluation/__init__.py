"""What drives come to: metrics, collisions, scores; drives in the place of recorded drivers."""

from urbanjax.evaluation.metrics import Metrics, evaluate, tracks
from urbanjax.evaluation.scores import Score, ScoreParams, score, terms

__all__ = ["Metrics", "Score", "ScoreParams", "evaluate", "score", "terms", "tracks"]
