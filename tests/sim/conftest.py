"""One road, one compiled step and one way to put vehicles on it, shared by the tests of the simulator."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.roadmap.builders import straight
from urbanjax.roadmap.builders.specs import RoadStyle
from urbanjax.sim import lanes as roads
from urbanjax.sim import world as worlds
from urbanjax.sim.agents import Traffic
from urbanjax.sim.lidar import LidarParams
from urbanjax.sim.scenarios.scenario import no_signals
from urbanjax.types import Command, VehicleState, as_arrays
from urbanjax.vehicle.params import VehicleParams

LIMIT = 50 / 3.6
V = 8


class Road:
    """Two lanes of 1 km in four sections: links 0, 2, 4, 6 on the left, 1, 3, 5, 7 on the right (y = 0)."""

    LEFT, RIGHT = 0, 1

    def __init__(self):
        self.graph = straight(2, 1000.0, style=RoadStyle(lane_width=3.5, speed_limit=LIMIT, section=250.0))
        self.lanes = roads.from_graph(self.graph)
        self.params = as_arrays(worlds.SimParams(vehicle=VehicleParams(), lidar=LidarParams()))
        self.step = jax.jit(worlds.step)

    def place(self, x, lane):
        """Link and station of a point x m along a lane."""
        section = min(int(x // 250), 3)
        return 2 * section + lane, x - 250.0 * section

    def traffic(self, *vehicles, n=V, dtype=None):
        """Vehicles from dicts: x, lane, speed, and any field of Traffic."""
        dtype = jnp.zeros(()).dtype if dtype is None else dtype
        rows = [{"speed": 0.0, "valid": True} | vehicle for vehicle in vehicles]
        rows += [{"x": 0.0, "lane": 1, "speed": 0.0, "valid": False}] * (n - len(rows))
        rows = [row | dict(zip(("link", "station"), self.place(row["x"], row["lane"]), strict=True)) for row in rows]
        default = {
            "moved": 1.0,
            "length": 4.5,
            "width": 1.9,
            "desired_speed": 1.0,
            "headway": 1.2,
            "politeness": 0.3,
            "reacts": True,
        }
        whole, flags = {"link", "other", "route"}, {"has_other", "changes", "reacts", "valid"}
        columns = {}
        for name in Traffic.__dataclass_fields__:
            values = [row.get(name, default.get(name, 0)) for row in rows]
            kind = jnp.int32 if name in whole else bool if name in flags else dtype
            columns[name] = jnp.asarray(np.array(values), kind)
        return Traffic(**columns)

    def world(self, traffic, ego_x=-500.0, ego_y=0.0, ego_speed=0.0, ego_link=1, heading=0.0):
        """A world; by default the ego stands far behind the road, out of everybody's way."""
        dtype = traffic.speed.dtype
        ego = VehicleState(
            jnp.asarray([ego_x, ego_y], dtype),
            *(jnp.asarray(value, dtype) for value in (heading, ego_speed, 0.0, 0.0)),
        )
        link = jnp.asarray(ego_link, jnp.int32)
        time = jnp.zeros((), dtype)
        return worlds.WorldState(ego, link, traffic, as_arrays(no_signals(), dtype), time, jnp.asarray(0, jnp.int32))

    def roll(self, world, steps, params=None, lanes=None, acceleration=0.0, steering=0.0):
        """States after each of the steps, the start included."""
        dtype = world.time.dtype
        command = Command(jnp.asarray(acceleration, dtype), jnp.asarray(steering, dtype))
        states = [world]
        for _ in range(steps):
            lanes_used, params_used = lanes or self.lanes, params or self.params
            states.append(self.step(params_used, lanes_used, states[-1], command, jnp.asarray(0.1, dtype)))
        return states


def x_of(traffic):
    """Way along the straight road [V] m."""
    return np.asarray(traffic.station) + 250.0 * (np.asarray(traffic.link) // 2)


@pytest.fixture(scope="session")
def road():
    return Road()
