"""One drive to be done: where, among whom, and what is asked."""

from jax import Array

from urbanjax.course import Course
from urbanjax.evaluation.aim import Aim
from urbanjax.registration.voxelmap import VoxelMap
from urbanjax.roadmap.corridor import Corridor
from urbanjax.sim.lanes import LaneTables
from urbanjax.sim.sensing import Sensing
from urbanjax.sim.world import WorldState
from urbanjax.types import pytree
from urbanjax.vehicle.params import VehicleParams


@pytree
class Case:
    """A road, a start on it and an aim, or C of them stacked along the first axis."""

    corridor: Corridor  # along the route
    lanes: LaneTables  # the simulator's tables, with the road graph
    start: WorldState
    goal: Array  # [] m, station of the route that the ego's box centre has to pass
    limit: Array  # [] s, within which
    vehicle: VehicleParams | None = None  # that drives; None: that of the closed loop
    aim: Aim | None = None  # what counts as having reached the goal instead of passing its station
    map: VoxelMap | None = None  # of the surroundings, for a driver that finds its pose from scans
    sensing: Sensing | None = None  # what it then sees; None: its pose is given

    @property
    def course(self) -> Course:
        """What the driver is given."""
        return Course(self.lanes.graph, self.corridor, self.map)
