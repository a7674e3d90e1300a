"""The margin to the edge of the road, beside point-in-polygon tests of every lane."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.path import Path
from scipy.spatial import cKDTree

from urbanjax.numerics.soft import Relaxation
from urbanjax.roadmap import builders
from urbanjax.roadmap.builders.specs import RoadStyle
from urbanjax.sim import lanes as roads
from urbanjax.sim import log as logs
from urbanjax.sim.agents import TrafficParams
from urbanjax.sim.scenarios.scenario import no_signals, traffic
from urbanjax.sim.world import SimParams, WorldState
from urbanjax.types import Command, VehicleState, as_arrays
from urbanjax.vehicle.params import VehicleParams

CRACK = 0.045  # m, about the gap between lanes that is none
CAR, BUS = VehicleParams(), VehicleParams(length=12.0, width=2.5, wheelbase=6.0, rear_overhang=3.0)
SHORT = RoadStyle(section=30.0, n_points=16)
ROADS = {
    "bend": lambda: builders.curve(radius=12.0, angle=2.0),
    "right bend": lambda: builders.curve(
        radius=20.0, angle=-1.5, n_lanes=1, style=RoadStyle(section=30.0, n_points=16)
    ),
    "two-way": lambda: builders.two_way(length=120.0, style=SHORT),
    "merge": lambda: builders.merge(before=80.0, parallel=60.0, after=80.0, ramp=60.0),
    "crossing": lambda: builders.intersection(n_points=16),
    "district": lambda: around(builders.district(), (720.0, 775.0), 60.0),
}


def around(graph, place, distance):
    """The graph with only those lanes that begin near a place: the ramps and turns of one junction."""
    gap = np.linalg.norm(np.asarray(graph.centre)[:, 0] - place, axis=1)
    return graph.replace(valid=graph.valid & (gap < distance))


class Ground:
    """The union of all lanes by the even-odd rule, and samples of its edge every 5 cm."""

    def __init__(self, graph):
        valid = np.asarray(graph.valid)
        left, right = (np.asarray(x, float)[valid] for x in (graph.left, graph.right))
        self.lanes = [np.concatenate(pair) for pair in zip(left, right[:, ::-1], strict=True)]
        outline = np.concatenate([self.walk(lane) for lane in self.lanes])
        self.outline = cKDTree(outline)
        edge = np.zeros(len(outline), bool)
        for angle in np.arange(16) * np.pi / 8:
            beside = outline + CRACK * np.array([np.cos(angle), np.sin(angle)])
            edge |= ~self.covers(beside) & (self.outline.query(beside)[0] > 0.6 * CRACK)
        self.edge = cKDTree(outline[edge])

    @staticmethod
    def walk(lane):
        closed = np.concatenate([lane, lane[:1]])
        station = np.r_[0, np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))]
        where = np.arange(0, station[-1], 0.05)
        return np.stack([np.interp(where, station, closed[:, i]) for i in range(2)], axis=1)

    def covers(self, points):
        inside = np.zeros(len(points), bool)
        for lane in self.lanes:
            near = np.flatnonzero(~inside & np.all((points >= lane.min(0)) & (points <= lane.max(0)), axis=1))
            inside[near] = Path(lane).contains_points(points[near])
        return inside

    def margin(self, points):
        """Distance to the edge, negative outside; cracks between lanes belong to the road."""
        distance = self.edge.query(points)[0]
        crack = (self.outline.query(points)[0] < 0.6 * CRACK) & (distance > CRACK)
        return np.where(self.covers(points) | crack, distance, -distance)


def outlines(centre, heading, vehicle):
    """Points [n, m, 2] every 10 cm along each box."""
    half = np.array([vehicle.length, vehicle.width]) / 2
    along, across = (np.linspace(-h, h, int(20 * h) + 1) for h in half)
    sides = [(x, y) for x in along for y in (-half[1], half[1])] + [(x, y) for y in across for x in (-half[0], half[0])]
    x, y = np.array(sides).T
    cos, sin = np.cos(heading)[:, None], np.sin(heading)[:, None]
    return centre[:, None] + np.stack([x * cos - y * sin, x * sin + y * cos], axis=-1)


def world(link, centre, heading, vehicle):
    """The ego alone, with its box there."""
    zeros, params = jnp.zeros(1), TrafficParams()
    nobody = traffic(zeros.astype(int), zeros, speed=zeros, limit=1.0, params=params, valid=zeros > 0)
    zero = jnp.zeros_like(heading)
    back = vehicle.centre_offset * jnp.stack([jnp.cos(heading), jnp.sin(heading)])
    ego = VehicleState(centre - back, heading, zero, zero, zero)
    return WorldState(ego, link, nobody, as_arrays(no_signals()), zero, jnp.zeros((), jnp.int32))


def margin(lanes, link, centre, heading, vehicle, relaxation=Relaxation()):
    params = as_arrays(SimParams(vehicle=vehicle))
    still = Command(jnp.zeros(()), jnp.zeros(()))
    now = world(link, centre, heading, vehicle)
    return logs.record(params, lanes, world=now, command=still, relaxation=relaxation).road_margin


def poses(graph, n, seed):
    """Links, and poses beside their centres."""
    rng = np.random.default_rng(seed)
    link, point = rng.choice(np.flatnonzero(graph.valid), n), rng.integers(0, graph.centre.shape[1], n)
    heading = np.asarray(graph.heading, float)[link, point]
    aside = rng.uniform(-3.0, 3.0, (n, 1)) * np.stack([-np.sin(heading), np.cos(heading)], axis=1)
    return link, np.asarray(graph.centre, float)[link, point] + aside, heading + rng.normal(0, 0.15, n)


@pytest.mark.parametrize("name", ROADS)
def test_margin_is_the_distance_to_the_edge_of_the_union_of_all_lanes(name):
    graph = ROADS[name]()
    lanes, ground = roads.from_graph(graph), Ground(graph)
    measure = jax.jit(jax.vmap(margin, in_axes=(None, 0, 0, 0, None)))
    for seed, vehicle in enumerate((CAR, BUS)):
        link, centre, heading = poses(graph, 200, seed)
        found = measure(lanes, jnp.asarray(link, jnp.int32), *as_arrays((centre, heading)), as_arrays(vehicle))
        points = outlines(centre, heading, vehicle)
        expected = ground.margin(points.reshape(-1, 2)).reshape(points.shape[:2]).min(axis=1)
        assert 0.1 < np.mean(expected < 0) < 0.99
        clear = np.abs(expected) > 0.05
        np.testing.assert_array_equal(found[clear] > 0, expected[clear] > 0)
        near = np.abs(expected) < 0.5
        error = np.abs(found - expected)[near]
        # Into a gap between two samples of the outline (0.6 m along a bus) the box reaches a little deeper.
        assert np.all(error < np.where(expected[near] > 0, 0.1, 0.15))
        assert np.median(error) < 0.01


def test_gradient_of_the_margin_is_finite_and_matches_differences(x64):
    graph = ROADS["bend"]()
    lanes, soft = roads.from_graph(graph), as_arrays(Relaxation(0.1, "soft"))
    link, centre, heading = poses(graph, 40, 0)
    pose = jnp.concatenate([jnp.asarray(centre), jnp.asarray(heading)[:, None]], axis=1)

    def value(link, pose):
        return margin(lanes, link, pose[:2], pose[2], as_arrays(CAR), soft)

    link = jnp.asarray(link, jnp.int32)
    gradient = jax.jit(jax.vmap(jax.grad(value, argnums=1)))(link, pose)
    assert np.all(np.isfinite(gradient))
    along = jax.jit(jax.vmap(value))
    differences = [(along(link, pose + step) - along(link, pose - step)) / 2e-6 for step in 1e-6 * jnp.eye(3)[:, None]]
    differ = np.abs(np.stack(differences, axis=1) - gradient).max(axis=1) > 1e-3
    assert differ.mean() < 0.1  # the nearest edge of a point may change between the two


def test_on_a_corner_of_the_edge_the_gradient_is_finite():
    lanes = roads.from_graph(ROADS["two-way"]())
    corner = lanes.graph.right[0, 0] + jnp.asarray([CAR.length, CAR.width]) / 2
    slope = jax.jit(jax.grad(lambda at: margin(lanes, jnp.int32(0), at, jnp.zeros(()), as_arrays(CAR))))
    assert np.all(np.isfinite(slope(corner)))


def test_a_gap_before_the_next_lane_belongs_to_the_road():
    graph = ROADS["two-way"]()
    gap = jnp.zeros_like(graph.centre).at[0, -1, 0].set(-0.3)
    lanes = roads.from_graph(graph.replace(left=graph.left + gap, right=graph.right + gap))
    over = graph.centre[0, -1] + jnp.asarray([0.0, -0.2])
    measured = jax.jit(margin)(lanes, jnp.int32(0), over, jnp.zeros(()), as_arrays(CAR))
    np.testing.assert_allclose(measured, (SHORT.lane_width - CAR.width) / 2 - 0.2, atol=0.01)
