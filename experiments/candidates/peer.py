"""Frenetix (extra `peers`) on the same grid, and how far its candidates, costs and limits are from ours.

Four things about version 0.4.0 are allowed for openly. It takes d' itself for the tangent of the heading (`heading`
"slope" here), integrates jerk over the first sample only, and counts plain norms over samples. And its polynomials
return half of the second derivative: accelerations and curvatures agree once ours are fed halves as well, which
`agreement` does; it states the difference with the true derivatives beside it.
"""

import importlib
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from urbanjax.planning.frenet_sampling import choice, limits
from urbanjax.planning.frenet_sampling.choice import FRENET_TERMS, FrenetParams
from urbanjax.planning.frenet_sampling.fan import FIELDS, FrenetFan, cartesian, generate
from urbanjax.planning.frenet_sampling.limits import FRENET_LIMITS
from urbanjax.planning.frenet_sampling.motion import EndGrid
from urbanjax.types import as_arrays

JERK_TIME = 0.1  # s
THEIRS = dict(zip(FIELDS, ("x", "y", "theta", "v", "kappa", "a"), strict=True))
COSTS = {"lateral_jerk": "lateral_jerk", "speed": "velocity_offset", "offset": "distance"}
LIMITS = {
    "curvature": "Curvature Constraint",
    "curvature_rate": "Curvature Rate Constraint",
    "acceleration": "Acceleration Constraint",
    "yaw_rate": "Yaw rate Constraint",
}


def library() -> Any | None:
    """The peer, or None where it is not installed."""
    try:
        return importlib.import_module("frenetix")
    except ImportError:
        return None


class Frenetix:
    """Frenetix with three costs and four limits, on one or more roads."""

    def __init__(self, study: Any, roads: list[Any], grid: EndGrid):
        """Everything that does not belong to planning is done here. Args: study and roads of `candidates`."""
        self.peer: Any = library()
        self.slow = grid.lateral == "station"
        functions = importlib.import_module("frenetix.trajectory_functions")
        self.handler = self.peer.TrajectoryHandler(float(grid.period))
        self._add_limits(functions.feasability_functions, study)
        self._add_costs(functions.cost_functions, study, float(grid.period))
        self.roads = [
            (
                functions.FillCoordinates(
                    self.slow, 0.0, self.peer.CoordinateSystemWrapper(road.path), grid.period * (grid.n_times - 1)
                ),
                self._samples(road.state, grid),
            )
            for road in roads
        ]

    def _add_limits(self, functions: Any, study: Any) -> None:
        steering, base, limits = float(study.vehicle.max_steering), float(study.vehicle.wheelbase), study.limits
        for function in (
            functions.CheckCurvatureConstraint(steering, base, True),
            functions.CheckCurvatureRateConstraint(base, float(limits.max_curvature_rate), True),
            functions.CheckAccelerationConstraint(float(limits.switching_speed), float(limits.max_acceleration), True),
            functions.CheckYawRateConstraint(steering, base, True),
        ):
            self.handler.add_feasability_function(function)

    def _add_costs(self, functions: Any, study: Any, period: float) -> None:
        weights, wish = study.weights, float(study.desired_speed)
        names = COSTS
        for function in (
            functions.CalculateLateralJerkCost(names["lateral_jerk"], float(weights.lateral_jerk)),
            functions.CalculateVelocityOffsetCost(names["speed"], float(weights.speed), wish, period, 1.1, False, 2),
            functions.CalculateDistanceToReferencePathCost(names["offset"], float(weights.offset)),
        ):
            self.handler.add_cost_function(function)

    def _samples(self, state: Any, grid: EndGrid) -> np.ndarray:
        """Its sampling matrix; durations a little longer, since it cuts them off to whole samples."""
        along, across = np.asarray(state.station, float), np.asarray(state.offset, float)
        if self.slow:
            slope = across[1] / along[1]
            across = np.array([across[0], slope, (across[2] - slope * along[2]) / along[1] ** 2])
        ends = np.meshgrid(np.asarray(grid.durations) + 1e-9, grid.speeds, grid.offsets, indexing="ij")
        matrix = np.zeros((ends[0].size, 13))
        matrix[:, 2:5], matrix[:, 7:10] = along, across
        matrix[:, [1, 5, 10]] = np.stack([e.ravel() for e in ends], axis=1)
        return matrix

    def run(self, concurrent: bool) -> None:
        """Generate, fill, check and rate all candidates on each road."""
        for fill, samples in self.roads:
            self.handler.add_function(fill)
            self.handler.generate_trajectories(samples, self.slow)
            if concurrent:
                self.handler.evaluate_all_current_functions_concurrent(True)
            else:
                self.handler.evaluate_all_current_functions(True)

    def trajectories(self) -> list[Any]:
        """Of the last road, in the order of the grid."""
        return sorted(self.handler.get_sorted_trajectories(), key=lambda t: t.uniqueId)


def _halved(fan: FrenetFan, grid: EndGrid) -> FrenetFan:
    """The fan that half of the second derivatives give."""
    along = fan.along.replace(acceleration=fan.along.acceleration / 2)
    across = fan.across.replace(second=fan.across.second / 2)
    return fan.replace(values=cartesian(along, across, grid=grid))


def _ordered(values: Any) -> np.ndarray:
    """[.., D, V, N, ...] of the first axis' entries, in the peer's order: durations, speeds, offsets."""
    values = np.swapaxes(np.asarray(values), 1, 3)
    return values.reshape(values.shape[0], -1, *values.shape[4:])


@jax.jit
def _ours(road: Any, params: FrenetParams, vehicle: Any, wish: jax.Array) -> tuple:
    fan = generate(road.line, road.state, grid=params.grid)
    halved = _halved(fan, params.grid)
    reasons = [limits.broken(f, None, vehicle=vehicle, grid=params.grid, limits=params.limits) for f in (halved, fan)]
    return halved.values, fan.values, choice.weighted_terms(fan, wish, params=params), *reasons


def agreement(road: Any, grid: EndGrid, params: FrenetParams, study: Any) -> dict[str, float]:
    """Largest differences from the peer over all candidates and points: name with unit to value.

    Names with `_true` compare our true second derivatives with its halves.
    """
    peer = Frenetix(study, [road], grid)
    peer.run(concurrent=False)
    theirs = peer.trajectories()
    wish = jnp.asarray(study.desired_speed, float)
    road = road.replace(path=jnp.zeros(()))
    halved, true, terms, halved_reasons, true_reasons = map(
        _ordered, _ours(road, params, as_arrays(study.vehicle), wish)
    )
    out: dict[str, float] = {"candidates": float(halved.shape[1]), "missing": float(halved.shape[1] - len(theirs))}
    if out["missing"]:
        return out
    units = ("m", "m", "rad", "mps", "per_m", "mps2")
    for i, (field, unit) in enumerate(zip(FIELDS, units, strict=True)):
        their = np.stack([np.asarray(getattr(t.cartesian, THEIRS[field])) for t in theirs])
        out[f"{field}_{unit}"] = float(np.abs(halved[i] - their).max())
        if field in ("curvature", "acceleration"):
            out[f"{field}_true_{unit}"] = float(np.abs(true[i] - their).max())
    for name, their_name in COSTS.items():
        their = np.array([t.costMap[their_name][1] for t in theirs])
        out[f"cost_{name}"] = float(np.abs(terms[FRENET_TERMS.index(name)] - their).max())
    for suffix, reasons in (("", halved_reasons), ("_true", true_reasons)):
        flags = [reasons[FRENET_LIMITS.index(name)] != _flags(theirs, their) for name, their in LIMITS.items()]
        out[f"flags_differing{suffix}"] = float(np.sum(flags))
    out["rejected"] = float(sum(not t.feasible for t in theirs))
    return out


def _flags(theirs: list[Any], name: str) -> np.ndarray:
    return np.array([t.feasabilityMap[name] > 0 for t in theirs])
