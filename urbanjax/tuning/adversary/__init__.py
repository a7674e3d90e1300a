"""Failures of a driver, searched for in the numbers of what another road user does, by gradient and without."""

from urbanjax.tuning.adversary.arena import Arena, Verdicts, arena
from urbanjax.tuning.adversary.hunt import Hunt, Trial, distinct, hunt
from urbanjax.tuning.adversary.kriged_search import KrigedSearch
from urbanjax.tuning.adversary.kriging import Kriging, Observed, krige
from urbanjax.tuning.adversary.threat import ThreatParams, threat

__all__ = [
    "Arena",
    "Hunt",
    "KrigedSearch",
    "Kriging",
    "Observed",
    "ThreatParams",
    "Trial",
    "Verdicts",
    "arena",
    "distinct",
    "hunt",
    "krige",
    "threat",
]
