"""What the usual scores are, for a reader of the report."""

from experiments.collect.scores import FIRST, SECOND

MEANINGS = {
    FIRST: "nuPlan's closed-loop score of a drive, 0 to 1",
    SECOND: "the share of drives that reach the goal within the limit without a violation",
    "carla_total": "the driving score of the CARLA leaderboard, 0 to 100",
    "commonroad_total": "CommonRoad's cost WX1",
    "competition_total": "the time to the goal with its penalties, in s",
    "epdms_driven_total": "NAVSIM's EPDMS of what was driven, 0 to 1",
}
SHARES = (FIRST, SECOND, "epdms_driven_total")


def is_share(name: str) -> bool:
    """Whether a score is from 0 to 1 by its definition. Args: name of it."""
    return name in SHARES or name.endswith(("_share", "_nuplan_score"))
