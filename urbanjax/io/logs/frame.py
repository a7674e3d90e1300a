"""Frames of logs: similarity transforms of the plane, and the closed form that fits one to pairs of points."""

import dataclasses

import numpy as np

from urbanjax.io.logs.record import LogError, VehicleLog
from urbanjax.types import host_record

TINY = 1e-300  # keeps a quotient of zeros at zero


@host_record
class Frame:
    """The map p -> scale R(rotation) F p + translation from a log's coordinates, F mirroring y where `reflected`."""

    scale: float = 1.0
    reflected: bool = False
    rotation: float = 0.0  # rad
    translation: tuple[float, float] = (0.0, 0.0)  # m

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Points [..., 2] of the log in the target frame."""
        flat = _complex(points)
        turned = self.scale * np.exp(1j * self.rotation) * (flat.conj() if self.reflected else flat)
        return _plane(np.asarray(turned + complex(*self.translation)))

    def heading(self, heading: np.ndarray) -> np.ndarray:
        """Headings [...] of the log in the target frame, rad."""
        return self.rotation + (-heading if self.reflected else heading)

    def log(self, log: VehicleLog) -> VehicleLog:
        """The log in the target frame; its speed and heading go along."""
        return dataclasses.replace(
            log,
            position=self.apply(log.position),
            speed=None if log.speed is None else self.scale * log.speed,
            heading=None if log.heading is None else self.heading(log.heading),
        )

    def inverse(self) -> "Frame":
        """The frame that leads back."""
        rotation = self.rotation if self.reflected else -self.rotation
        back = Frame(1 / self.scale, self.reflected, rotation)
        x, y = -back.apply(np.array(self.translation))
        return dataclasses.replace(back, translation=(float(x), float(y)))


def _complex(points: np.ndarray) -> np.ndarray:
    points = np.asarray(points, float)
    return np.asarray(points[..., 0] + 1j * points[..., 1])


def _plane(values: np.ndarray) -> np.ndarray:
    return np.stack([values.real, values.imag], -1)


def fit(
    source: np.ndarray, target: np.ndarray, *, reflected: bool = False, scale: tuple[float, float] = (1.0, 1.0)
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Factors [...] and translations [...] (complex: z -> factor z + translation) of least squares, and rms [...], m.

    Umeyama's solution, in which a complex factor is rotation and scale at once.
    Args: source, target [..., n, 2] m, pairs of points; reflected, whether y of the source is mirrored first; scale,
    limits of the scale.
    """
    a, b = _complex(source), _complex(target)
    a = a.conj() if reflected else a
    middle_a, middle_b = a.mean(-1, keepdims=True), b.mean(-1, keepdims=True)
    a0, b0 = a - middle_a, b - middle_b
    cross, size = np.sum(a0.conj() * b0, -1), np.sum(np.abs(a0) ** 2, -1)
    rotation = np.where(np.abs(cross) > 0, cross / np.maximum(np.abs(cross), TINY), 1.0)
    factor = rotation * np.clip(np.abs(cross) / np.maximum(size, TINY), *scale)
    rms = np.sqrt(np.mean(np.abs(factor[..., None] * a0 - b0) ** 2, -1))
    return np.asarray(factor), np.asarray(middle_b[..., 0] - factor * middle_a[..., 0]), np.asarray(rms)


def frame(factor: complex, translation: complex, *, reflected: bool) -> Frame:
    """The frame of a complex factor and translation.

    Args: factor, whose size is the scale and whose angle the rotation; translation, x + iy, m; reflected, whether y is
    mirrored first.
    """
    x, y = float(np.real(translation)), float(np.imag(translation))
    return Frame(float(abs(factor)), reflected, float(np.angle(factor)), (x, y))


def apart(one: Frame, other: Frame, *, points: np.ndarray) -> float:
    """Root mean square distance, m, between where two frames put points [n, 2].

    Args: one, other, frames; points [n, 2] m of the log.
    """
    return float(np.sqrt(np.mean(np.sum((one.apply(points) - other.apply(points)) ** 2, -1))))


def from_pairs(
    source: np.ndarray, target: np.ndarray, *, reflection: str = "no", scale: tuple[float, float] = (1.0, 1.0)
) -> tuple[Frame, np.ndarray]:
    """The frame of least squares for pairs of points [n, 2], n > 1, and their distances in it [n], m.

    Args: source, target [n, 2] m; reflection, no, yes or either; scale, its limits. Raises LogError for points that fix
    no frame.
    """
    source, target = np.asarray(source, float), np.asarray(target, float)
    if source.shape != target.shape or source.ndim != 2 or source.shape[-1] != 2 or len(source) < 2:
        raise LogError(f"pairs of points: {source.shape} and {target.shape} are not both [n, 2] with n > 1")
    if not (np.isfinite(source).all() and np.isfinite(target).all()):
        raise LogError("pairs of points: not all are finite")
    if min(np.ptp(source, axis=0).max(), np.ptp(target, axis=0).max()) <= 0.0:
        raise LogError("pairs of points: all are one point, which fixes no rotation")
    found = [(mirrored, fit(source, target, reflected=mirrored, scale=scale)) for mirrored in mirrors(reflection)]
    mirrored, (factor, translation, _) = min(found, key=lambda item: float(item[1][2]))
    best = frame(complex(factor), complex(translation), reflected=mirrored)
    return best, np.linalg.norm(best.apply(source) - target, axis=-1)


def mirrors(reflection: str) -> tuple[bool, ...]:
    """The reflections to try.

    Args: reflection, the word. Raises LogError for another word than no, yes and either.
    """
    known = {"no": (False,), "yes": (True,), "either": (False, True)}
    if reflection not in known:
        raise LogError(f"reflection must be one of {', '.join(known)}, not {reflection!r}")
    return known[reflection]
