"""The extended road graph M_ext: the lanes across a route, on uniform stations along its reference line."""

from jax import Array

from urbanjax.types import pytree, static


@pytree
class ExtendedGraph:
    """N stations, `spacing` apart, along the route's reference line; Q lanes across, from right (0) to left (Q - 1).

    Lane Q // 2 is the route's own lane, so its offset is 0 (but for the blend where the route changes lanes). The
    whole route is one such table; `window` cuts the part around the vehicle, with the same fields and fewer stations.
    """

    station: Array  # [N] m from the start of the route, uniform
    position: Array  # [N, 2] m, reference line
    heading: Array  # [N] rad, unwrapped
    curvature: Array  # [N] 1/m
    lane_offset: Array  # [N, Q] m, lane centres, left positive
    lane_width: Array  # [N, Q] m
    lane_link: Array  # [N, Q] int32, link of the road graph
    has_lane: Array  # [N, Q] bool
    oncoming: Array  # [N, Q] bool, a lane whose direction is against the route
    change: Array  # [N, Q - 1] bool, changing between lanes q and q + 1 is permitted here
    speed_limit: Array  # [N] m/s
    turn: Array  # [N] int32, Turn of the route's link
    valid: Array  # [N] bool, false beyond the end of the route
    length: Array  # [] m, of the route
    stop_station: Array  # [Y] m, stop lines on the route
    stop_signal: Array  # [Y] int32, signal id of each
    has_stop: Array  # [Y] bool
    spacing: float = static(default=1.0)  # m

    @property
    def route_lane(self) -> int:
        """Index across of the route's own lane."""
        return self.lane_offset.shape[-1] // 2
