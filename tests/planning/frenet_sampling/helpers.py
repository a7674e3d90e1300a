"""Reference lines, grids of end states and the compiled planner for tests of the Frenet candidates."""

import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np
from scipy.interpolate import CubicSpline

from urbanjax.numerics.soft import Relaxation
from urbanjax.planning.frenet_sampling import choice
from urbanjax.planning.frenet_sampling.choice import FrenetParams
from urbanjax.planning.frenet_sampling.fan import generate
from urbanjax.planning.frenet_sampling.line import reference_line
from urbanjax.planning.frenet_sampling.motion import EndGrid, FrenetState
from urbanjax.types import Prediction, as_arrays
from urbanjax.vehicle.driving import Driving
from urbanjax.vehicle.params import VehicleParams

OFFSETS, SPEEDS, ACCELERATIONS, DURATIONS = (-1.5, 0.0, 1.5), (6.0, 12.0), (0.0, 1.0), (1.0, 2.0)
START = (10.0, 9.0, 0.4), (0.5, 0.3, -0.2)
WISH = 10.0
VEHICLE = VehicleParams()


def grid(**changes) -> EndGrid:
    return EndGrid(OFFSETS, SPEEDS, ACCELERATIONS, DURATIONS, n_times=26).replace(**changes)


def curved(station, sign=1.0):
    """Heading and curvature of a winding line."""
    return sign * 0.6 * (1 - np.cos(station / 20)), sign * 0.03 * np.sin(station / 20)


def circular(curvature):
    return lambda station: (curvature * station, curvature + 0 * station)


@functools.cache
def place(shape):
    """Position [m] as a function of the station, integrated finely."""
    fine = np.linspace(-5, 120, 25001)
    angle = shape(fine)[0]
    direction = np.stack([np.cos(angle), np.sin(angle)], 1)
    spline = CubicSpline(fine, direction).antiderivative()
    return lambda station: spline(station) - spline(0.0)


def line_of(shape, spacing=0.5, length=80.0):
    station = np.arange(0.0, length + spacing / 2, spacing)
    heading, curvature = shape(station)
    position, heading, curvature = (jnp.asarray(v, float) for v in (place(shape)(station), heading, curvature))
    start, spacing = jnp.asarray(0.0), jnp.asarray(spacing)
    return reference_line(position, heading, curvature=curvature, start=start, spacing=spacing)


def state(station=START[0], offset=START[1]) -> FrenetState:
    return as_arrays(FrenetState(jnp.array(station), jnp.array(offset)))


def scene_params(**changes) -> FrenetParams:
    return as_arrays(FrenetParams(grid=grid(**changes)))


@functools.cache
def compiled(function):
    return jax.jit(function)


def fan_of(line, begin, ends):
    return compiled(generate)(line, begin, grid=as_arrays(ends))


def driving_of(params, relaxation) -> Driving:
    return as_arrays(Driving(VEHICLE, params, relaxation, 0.1))


def plan_of(line, begin=None, prediction=None, params=None, mode="hard", temperature=0.1, wish=WISH):
    begin = state() if begin is None else begin
    driving = driving_of(scene_params() if params is None else params, Relaxation(temperature, mode=mode))
    wish = jnp.asarray(wish)
    return compiled(choice.plan)(line, begin, desired_speed=wish, prediction=prediction, driving=driving)


def solved(start, end, time, order):
    """Polynomial through derivatives 0, 1, 2 at 0 and (derivative, value) pairs at `time`, by linear equations."""
    rows, values = [], []
    for at, conditions in ((0.0, list(enumerate(start))), (time, end)):
        for derivative, value in conditions:
            rows.append([np.polynomial.Polynomial.basis(i).deriv(derivative)(at) for i in range(order + 1)])
            values.append(value)
    return np.polynomial.Polynomial(np.linalg.solve(np.array(rows), np.array(values)))


def motions(begin=START, lateral="time"):
    """Station and offset over time of every candidate, in the order of the fan, from their definition."""
    for d, v, a, n in itertools.product(OFFSETS, SPEEDS, ACCELERATIONS, DURATIONS):
        s = solved(begin[0], [(1, v), (2, a)], n, 4)
        if lateral == "time":
            across = solved(begin[1], [(0, d), (1, 0.0), (2, 0.0)], n, 5)
            yield n, s, across, across
        else:
            slope = begin[1][1] / begin[0][1]
            bend = (begin[1][2] - slope * begin[0][2]) / begin[0][1] ** 2
            across = solved((begin[1][0], slope, bend), [(0, d), (1, 0.0), (2, 0.0)], s(n) - s(0.0), 5)
            yield n, s, across, lambda t, across=across, s=s: across(s(t) - s(0.0))


def each(values):
    """[.., D, V * A, N, T] -> [.., candidates, T] in double precision."""
    values = np.asarray(values, float)
    return values.reshape(*values.shape[:-4], -1, values.shape[-1])


def cars(places, velocity=0.0) -> Prediction:
    """Boxes (x, y, heading) that move along x."""
    time = np.linspace(0, 4, 5)
    position = np.array([[[x + velocity * t, y] for t in time] for x, y, _ in places])
    heading = np.array([[h] * len(time) for _, _, h in places])
    size = np.ones(len(places))
    valid = jnp.arange(len(places)) < len(places) - 1
    return as_arrays(Prediction(position, heading, velocity * size, 4.5 * size, 1.8 * size, time, valid))
