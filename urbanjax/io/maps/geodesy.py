"""Latitude and longitude on a plane."""

import numpy as np

AXIS = 6_378_137.0  # m, half of the larger axis of WGS 84
ECCENTRICITY = 0.00669437999014  # squared


def transverse_mercator(
    latitude: np.ndarray, longitude: np.ndarray, *, middle: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """East and north [m] of `middle` (latitude, longitude) for positions in degrees, true to scale at its meridian.

    The usual series to the sixth order, exact to a millimetre within 100 km of the meridian. Away from it the scale
    grows: lengths are 3e-7 too large at 5 km and 1.3e-4 at 100 km.
    Args: latitude, longitude [n] deg; middle, latitude and longitude in deg.
    """
    e, second = ECCENTRICITY, ECCENTRICITY / (1 - ECCENTRICITY)
    phi = np.radians(latitude)
    curvature = AXIS / np.sqrt(1 - e * np.sin(phi) ** 2)
    t, c = np.tan(phi) ** 2, second * np.cos(phi) ** 2
    a = np.radians(longitude - middle[1]) * np.cos(phi)
    east = a + (1 - t + c) * a**3 / 6 + (5 - 18 * t + t**2 + 72 * c - 58 * second) * a**5 / 120
    north = a**2 / 2 + (5 - t + 9 * c + 4 * c**2) * a**4 / 24
    north = north + (61 - 58 * t + t**2 + 600 * c - 330 * second) * a**6 / 720
    meridian = _meridian(phi) - _meridian(np.radians(np.array([middle[0]])))
    return curvature * east, meridian + curvature * np.tan(phi) * north


def _meridian(phi: np.ndarray) -> np.ndarray:
    """Length [m] of the meridian from the equator to a latitude [rad]."""
    e = ECCENTRICITY
    series = (1 - e / 4 - 3 * e**2 / 64 - 5 * e**3 / 256) * phi
    series = series - (3 * e / 8 + 3 * e**2 / 32 + 45 * e**3 / 1024) * np.sin(2 * phi)
    series = series + (15 * e**2 / 256 + 45 * e**3 / 1024) * np.sin(4 * phi)
    return AXIS * (series - 35 * e**3 / 3072 * np.sin(6 * phi))
