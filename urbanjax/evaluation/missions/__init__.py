"""What drivers are asked to do: kinds of drives by name."""

from urbanjax.evaluation.missions.hard import HARD
from urbanjax.evaluation.missions.mission import Mission
from urbanjax.evaluation.missions.qualification import QUALIFICATION

MISSIONS = {mission.name: mission for mission in (*QUALIFICATION, *HARD)}

__all__ = ["HARD", "MISSIONS", "QUALIFICATION", "Mission"]
