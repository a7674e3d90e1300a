"""A furnished street with a map and a localizer of small shapes, shared by all tests of localization."""

import types

import jax
import jax.numpy as jnp
import pytest

from urbanjax.localization import lidar, mapping
from urbanjax.localization.lidar import LidarLocalizerParams
from urbanjax.localization.odometry import OdometryParams
from urbanjax.localization.sliding import SlidingParams
from urbanjax.registration import MapParams, PreprocessParams
from urbanjax.registration.downsample import DownsampleParams
from urbanjax.registration.voxelmap import CutParams
from urbanjax.roadmap.builders import straight
from urbanjax.sim.lidar import LidarParams, sweep
from urbanjax.sim.scenery.scenery import furnish
from urbanjax.types import LaneOffset, Observation, Odometry, VehicleState, as_arrays

SENSOR = LidarParams(pattern="vlp_16", columns=256, nearby=48, noise=0.02, dropout=0.05, max_range=60.0)
LOCALIZER = LidarLocalizerParams(
    mount=SENSOR.mount,
    period=0.1,
    preprocess=PreprocessParams(downsample=DownsampleParams(resolution=0.5, capacity=2048)),
    sliding=SlidingParams(smallest=50.0, standing=50.0, cut=CutParams(capacity=12288, shape=(128, 128, 16))),
    odometry=OdometryParams(map=MapParams(shape=(128, 128, 16)), keyframes=3),
)
PERIOD = 0.1


def lane_offset(offset: float, valid: bool, age: float) -> LaneOffset:
    return LaneOffset(jnp.array(offset, float), jnp.array(valid), jnp.array(age, float))


class Street:
    """200 m of road; everything is seen from the lane, driven along at 10 m/s."""

    def __init__(self) -> None:
        self.graph = straight(2, 200.0)
        self.surroundings = furnish(self.graph, 3)
        self.sensor, self.localizer = as_arrays((SENSOR, LOCALIZER))
        self._sweep = jax.jit(sweep)
        self._cloud = jax.jit(lambda params, seen: lidar.cloud_of(params, seen)[0])
        self.step = jax.jit(lidar.step)
        self.init = jax.jit(lidar.init)
        self.points = mapping.build(self._mapped(), resolution=0.5)
        self.map = mapping.distributions(self.points, MapParams())

    def ego(self, x: float, y: float = 0.0, heading: float = 0.0, speed: float = 10.0) -> VehicleState:
        zero = jnp.zeros(())
        return VehicleState(jnp.array([x, y]), zero + heading, zero + speed, zero, zero)

    def observe(self, ego: VehicleState, seed: int, lost: bool = False, lane=(0.0, False, 0.0)) -> Observation:
        """What the localizer sees there. Args: lane, a LaneOffset's fields: none is seen unless said."""
        zero = jnp.zeros(())
        scan = self._sweep(
            self.sensor, self.surroundings, vehicles=None, ego=ego, yaw_rate=zero, key=jax.random.key(seed)
        )
        scan = scan.replace(valid=scan.valid & (not lost))
        odometry = Odometry(ego.speed, zero, zero, zero)
        nothing = {"objects": None, "signals": None}
        return Observation(odometry=odometry, scan=scan, lane_offset=lane_offset(*lane), **nothing)

    def _mapped(self):
        for k, x in enumerate(range(10, 190, 4)):
            cloud = self._cloud(self.localizer, self.observe(self.ego(float(x), speed=0.0), 1000 + k))
            yield cloud, mapping.matrix(float(x), 0.0, heading=0.0)


@pytest.fixture(scope="session")
def street() -> Street:
    return Street()


@pytest.fixture(scope="session")
def drive(street):
    """Thirty scans from x = 60 m on; scans 12 to 15 do not arrive."""
    state = street.init(street.localizer, street.ego(60.0).pose)
    states, found, truth = [state], [], []
    for k in range(30):
        ego = street.ego(60.0 + 10.0 * PERIOD * k)
        located, state = street.step(
            street.localizer, street.map, street.graph, state, street.observe(ego, k, lost=12 <= k < 16)
        )
        found.append(jax.device_get(located))
        states.append(state)
        truth.append(ego)
    return types.SimpleNamespace(states=states, found=found, truth=truth)
