"""By how much the stated covariance misses the errors: a further scale s^2 fitted on some, tested on others."""

from collections.abc import Callable
from typing import Any

import jax
import jaxlie
import numpy as np
from jax import Array
from scipy import stats

from experiments.register.bench import Bench, Found, Seen
from urbanjax.evaluation import statistics
from urbanjax.localization import motion, sliding
from urbanjax.localization.sliding import SlidingParams
from urbanjax.registration.distributions import DistributionMap
from urbanjax.registration.voxelmap import VoxelMap
from urbanjax.types import SHARE, as_arrays, field, host_record, pytree, static

DEGREES = 3  # x, y, heading


@pytree
class CalibrationParams:
    """Poses drawn around the drive, and starts drawn around them: what a prediction by odometry would be."""

    aside: float = 0.5  # m, standard deviation of the pose, across the lane
    turned: float = 0.03  # rad, likewise
    start_position: float = 0.1  # m, standard deviation of the start
    start_heading: float = 0.01  # rad, likewise
    level: float = field(default=0.95, metadata=SHARE)  # share of the errors that s^2 is to cover
    fit: int = static(default=1000, metadata={"range": (10, 1_000_000)})
    test: int = static(default=500, metadata={"range": (10, 1_000_000)})


@host_record
class Errors:
    """Planar errors [N, 3] (m, m, rad) in the body frame with the covariances [N, 3, 3] that were stated."""

    twist: np.ndarray
    covariance: np.ndarray
    converged: np.ndarray  # [N]

    @property
    def nees(self) -> np.ndarray:
        """Normalised squared errors e' C^-1 e [N] of those that converged."""
        e, c = self.twist[self.converged].astype(float), self.covariance[self.converged].astype(float)
        return np.einsum("ni,ni->n", e, np.linalg.solve(c, e[..., None])[..., 0])


@host_record
class Calibration:
    """The scale and what it does to errors that it was not fitted on."""

    scale: float  # s^2
    level: float
    fit: Errors
    test: Errors

    @property
    def factors(self) -> np.ndarray:
        """Root mean squares [3] of longitudinal, lateral and heading test errors over their stated deviations."""
        variance = np.diagonal(self.test.covariance, axis1=1, axis2=2)
        return np.sqrt((self.test.twist**2 / variance)[self.test.converged].mean(0))

    def coverage(self, level: float | None = None, scale: float | None = None) -> float:
        """Share of the test errors inside the ellipsoid of `level`, with the fitted or another scale."""
        return float(self.inside(level, scale).mean())

    def inside(self, level: float | None = None, scale: float | None = None) -> np.ndarray:
        """Which test errors [N] are inside that ellipsoid."""
        level, scale = self.level if level is None else level, self.scale if scale is None else scale
        return self.test.nees / scale <= stats.chi2.ppf(level, DEGREES)


def fitted_scale(nees: np.ndarray, level: float) -> float:
    """S^2 with which that share of normalised squared errors lies inside the ellipsoid of chi^2 with 3 degrees."""
    return float(np.quantile(nees, level) / stats.chi2.ppf(level, DEGREES))


def calibrate(
    bench: Bench, params: CalibrationParams, seed: int, tick: Callable[[str, float | None], None]
) -> Calibration:
    """The localizer's own registration, at poses and with noise drawn anew for each error."""
    total, done = params.fit + params.test, iter(range(params.fit + params.test))
    parts = [
        errors(bench, params, count, (seed, part), lambda: tick("calibration", next(done) / total))
        for part, count in enumerate((params.fit, params.test))
    ]
    return Calibration(fitted_scale(parts[0].nees, float(params.level)), float(params.level), *parts)


def errors(
    bench: Bench, params: CalibrationParams, count: int, seed: tuple[int, int], tick: Callable[[], None]
) -> Errors:
    """So many registrations with what they said of themselves."""
    rng = np.random.default_rng(seed)
    found = []
    for n in range(count):
        k = int(rng.integers(0, len(bench.stretch.tour.time)))
        aside = float(params.aside) * rng.normal(), float(params.turned) * rng.normal()
        key = jax.random.fold_in(jax.random.key(1000 * seed[0] + 10 + seed[1]), n)
        seen = bench.look(k, key, aside)
        spread = (float(params.start_position),) * 2 + (float(params.start_heading),)
        off = as_arrays(jaxlie.SE2.from_xy_theta(*(float(s * rng.normal()) for s in spread)))
        found.append(_one(bench, seen, seen.truth @ motion.spatial(off)))
        tick()
    return Errors(
        *(np.stack([np.asarray(getattr(f, name)) for f in found]) for name in ("twist", "covariance", "converged"))
    )


def _one(bench: Bench, seen: Seen, start: jaxlie.SE3) -> Found:
    """A registration with the parameters of the localizer."""
    localizer = bench.localizer
    _, cloud, _ = bench.cloud(seen, seen.scan.valid.shape[0], float(localizer.sensing_radius))
    world = bench.map("vgicp", 1.0)
    _, (window, _) = bench.programs(_window, world, start.translation(), seen.odometry.speed, localizer.sliding)
    return bench.aligned(localizer.align, cloud, window, start.normalize(), seen.truth)[1]


def _window(world: VoxelMap, position: Array, speed: Array, params: SlidingParams) -> tuple[DistributionMap, Array]:
    return sliding.window(world, position, speed=speed, params=params)


def summary(found: Calibration) -> dict[str, float]:
    """Flat numbers."""
    return {
        "covariance_scale": found.scale,
        **statistics.rate(found.inside()).flat("coverage_share"),
        **statistics.rate(found.inside(scale=1.0)).flat("coverage_unscaled_share"),
        **statistics.rate(found.inside(0.5)).flat("coverage_at_50_percent_share"),
        **statistics.rate(found.inside(0.99)).flat("coverage_at_99_percent_share"),
        **{
            f"error_over_stated_{n}": x
            for n, x in zip(("longitudinal", "lateral", "heading"), found.factors, strict=True)
        },
        "calibration_errors": len(found.test.nees),
        "calibration_not_converged": int((~found.test.converged).sum() + (~found.fit.converged).sum()),
        "calibration_longitudinal_std_m": float(found.test.twist[:, 0].std()),
        "calibration_lateral_std_m": float(found.test.twist[:, 1].std()),
        "calibration_heading_std_rad": float(found.test.twist[:, 2].std()),
        "calibration_largest_error_m": float(np.hypot(*found.test.twist[:, :2].T).max()),
    }


def table(found: Calibration) -> dict[str, Any]:
    """One row per error, for the table on disk."""
    parts = ("fit", found.fit), ("test", found.test)
    twist = np.concatenate([errors.twist for _, errors in parts])
    variance = np.concatenate([np.diagonal(errors.covariance, axis1=1, axis2=2) for _, errors in parts])
    out: dict[str, Any] = {"set": [name for name, errors in parts for _ in errors.converged]}
    for k, (name, unit) in enumerate((("longitudinal", "m"), ("lateral", "m"), ("heading", "rad"))):
        out[f"{name}_error_{unit}"] = twist[:, k]
        out[f"{name}_stated_std_{unit}"] = np.sqrt(variance[:, k])
    return out | {"converged": np.concatenate([errors.converged for _, errors in parts])}
