"""What a drive is worth: one file for each published score, and the smooth one that tuning climbs."""

from urbanjax.evaluation.scores.smooth import Score, ScoreParams, score, terms

__all__ = ["Score", "ScoreParams", "score", "terms"]
