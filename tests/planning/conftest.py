"""One compiled planning pipeline for all tests, and roads, objects and vehicles made by hand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.numerics.soft import Relaxation
from urbanjax.planning.params import PlanningParams
from urbanjax.planning.plan import Memory, plan
from urbanjax.planning.previous import nothing
from urbanjax.planning.situation import Situation
from urbanjax.roadmap.corridor import ANYWHERE, Corridor
from urbanjax.roadmap.progress import Progress
from urbanjax.types import Prediction, VehicleState, as_arrays
from urbanjax.vehicle.driving import Driving
from urbanjax.vehicle.params import VehicleParams

LANES = 5


def small_params() -> PlanningParams:
    """Sizes that compile fast; everything else by default."""
    params = PlanningParams()
    return as_arrays(
        params.replace(
            macro=params.macro.replace(n_layers=12, nodes_per_lane=3),
            primitives=params.primitives.replace(n_points=25, offsets=(-0.6, 0.0, 0.6), durations=(2.0, 4.0)),
        )
    )


class Scenes:
    """Roads, objects and vehicles made by hand."""

    @staticmethod
    def road(
        curvature=0.0, lanes=(2, 3), oncoming=(), barred=(), limit=14.0, width=3.5, origin=(0.0, 0.0), heading=0.0
    ) -> Corridor:
        """A straight road or a circular arc from 20 m before `origin` on, with the given lanes of the five across."""
        station = np.arange(0.0, 221.0)
        s, n = station - 20.0, station.size
        angle = curvature * s
        if curvature:
            x, y = np.sin(angle) / curvature, (1 - np.cos(angle)) / curvature
        else:
            x, y = s, 0 * s
        cos, sin = np.cos(heading), np.sin(heading)
        has = np.isin(np.arange(LANES), lanes)
        change = has[:-1] & has[1:] & ~np.isin(np.arange(LANES - 1), barred)

        def every(row):
            return jnp.asarray(np.broadcast_to(row, (n, len(row))))

        return Corridor(
            station=jnp.asarray(station),
            position=jnp.asarray(np.stack([x * cos - y * sin + origin[0], x * sin + y * cos + origin[1]], axis=-1)),
            heading=jnp.asarray(angle + heading),
            curvature=jnp.full(n, float(curvature)),
            lane_offset=every((np.arange(LANES) - LANES // 2) * width),
            lane_width=jnp.full((n, LANES), width),
            lane_link=jnp.zeros((n, LANES), jnp.int32),
            has_lane=every(has),
            oncoming=every(np.isin(np.arange(LANES), oncoming)),
            change=every(change),
            speed_limit=jnp.full(n, limit),
            turn=jnp.zeros(n, jnp.int32),
            rank=jnp.zeros(n),
            line=jnp.full(n, ANYWHERE),
            valid=jnp.ones(n, bool),
            length=jnp.asarray(station[-1]),
            stop_station=jnp.zeros(1),
            stop_signal=jnp.zeros(1, jnp.int32),
            has_stop=jnp.zeros(1, bool),
            spacing=1.0,
        )

    @staticmethod
    def place(window: Corridor, station: float, offset: float) -> tuple[np.ndarray, float]:
        """Position and heading of the road at a station and a lateral offset, in closed form."""
        k, first = float(window.curvature[0]), np.asarray(window.position[0], float)
        h0 = float(window.heading[0])
        h = h0 + k * station
        along = np.array([np.cos(h0), np.sin(h0)]) * station
        if k:
            along = np.array([np.sin(h) - np.sin(h0), np.cos(h0) - np.cos(h)]) / k
        return first + along + offset * np.array([-np.sin(h), np.cos(h)]), h

    @classmethod
    def ego(cls, window, station=20.0, offset=0.0, turned=0.0, speed=10.0, steering=0.0, acceleration=0.0):
        """The ego on the road: its progress and its state."""
        position, heading = cls.place(window, station, offset)
        a, dtype = jnp.asarray, window.station.dtype
        return (
            Progress(station=a(station, dtype), offset=a(offset, dtype), heading_error=a(turned, dtype)),
            VehicleState(
                position=a(position, dtype),
                heading=a(heading + turned, dtype),
                speed=a(speed, dtype),
                acceleration=a(acceleration, dtype),
                steering=a(steering, dtype),
            ),
        )

    @classmethod
    def traffic(cls, window, cars, total=3, horizon=8.0, n=17) -> Prediction:
        """Cars (station, offset, speed) that keep their lane, padded with invalid ones to `total`."""
        time = np.linspace(0, horizon, n)
        position, heading, speed = np.zeros((total, n, 2)), np.zeros((total, n)), np.zeros(total)
        for i, (station, offset, v) in enumerate(cars):
            for k, t in enumerate(time):
                position[i, k], heading[i, k] = cls.place(window, station + v * t, offset)
            heading[i] += np.pi * (v < 0)
            speed[i] = abs(v)
        a, dtype = jnp.asarray, window.station.dtype
        return Prediction(
            position=a(position, dtype),
            heading=a(heading, dtype),
            speed=a(speed, dtype),
            length=jnp.full(total, 4.7, dtype),
            width=jnp.full(total, 1.9, dtype),
            time=a(time, dtype),
            valid=jnp.arange(total) < len(cars),
        )


def seen(window, progress, state, prediction) -> Situation:
    """What planning sees of the situation; it reads no objects and no signals."""
    return Situation(window, progress, state, objects=None, prediction=prediction, signals=None)


def run(window, progress, state, prediction, previous_macro, previous_micro, vehicle, params, relaxation):
    """What each of the three planning stages came to."""
    driving = Driving(vehicle, params, relaxation, 0.1)
    made = plan(seen(window, progress, state, prediction), driving, memory=Memory(previous_macro, previous_micro))
    return made.macro, made.fan, made.micro


class Planner:
    """The compiled pipeline with small sizes, for one dtype at a time."""

    def __init__(self):
        self.compiled = jax.jit(run)

    def __call__(self, window, ego, prediction, params=None, mode="hard", temperature=0.1, previous=None):
        params = small_params() if params is None else as_arrays(params)
        relaxation = as_arrays(Relaxation(temperature, mode=mode))
        previous = previous or (nothing(params.macro.n_layers), nothing(params.primitives.n_points))
        # Strong types throughout: a weakly typed number would compile the pipeline once more.
        previous = as_arrays(previous)
        return self.compiled(window, *ego, prediction, *previous, as_arrays(VehicleParams()), params, relaxation)


@pytest.fixture(scope="session")
def planner() -> Planner:
    return Planner()


@pytest.fixture(scope="session")
def scenes() -> type[Scenes]:
    return Scenes


@pytest.fixture(scope="session")
def params() -> PlanningParams:
    return small_params()
