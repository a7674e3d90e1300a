"""What logs of traffic say: divergence and similarity of driving, safety and flow (Eq. 30-33, Tables III-VIII)."""

from urbanjax.traffic.divergence.plain import KlDivergence, kl_divergence
from urbanjax.traffic.resampling import ResamplingParams
from urbanjax.traffic.safety.measure import Safety, SafetyParams
from urbanjax.traffic.safety.surrogate import surrogate_safety

__all__ = [
    "KlDivergence",
    "ResamplingParams",
    "Safety",
    "SafetyParams",
    "kl_divergence",
    "surrogate_safety",
]
