"""Everything that behaviour planning can be told."""

from urbanjax.behavior.candidates import ConnectParams
from urbanjax.behavior.caps import CapParams
from urbanjax.behavior.gvp import GVPParams
from urbanjax.behavior.lanes import LaneParams
from urbanjax.behavior.right_of_way import RightOfWayParams
from urbanjax.behavior.surroundings import OccupancyParams
from urbanjax.behavior.tree import TSPSParams
from urbanjax.planning.clearance import ClearanceParams
from urbanjax.types import pytree
from urbanjax.vehicle.following import HeadwayParams
from urbanjax.vehicle.profile import ProfileParams


@pytree
class BehaviorParams:
    """Path selection (TSPS) and speed planning (GVP)."""

    tsps: TSPSParams = TSPSParams()
    gvp: GVPParams = GVPParams()
    headway: HeadwayParams = HeadwayParams()
    connect: ConnectParams = ConnectParams()
    lanes: LaneParams = LaneParams()
    occupancy: OccupancyParams = OccupancyParams()
    caps: CapParams = CapParams()
    right_of_way: RightOfWayParams = RightOfWayParams()
    clearance: ClearanceParams = ClearanceParams()
    profile: ProfileParams = ProfileParams()
