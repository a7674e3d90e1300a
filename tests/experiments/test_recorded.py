"""Drives among recorded traffic, on a made-up recording of a straight road."""

import dataclasses

import jax
import numpy as np
import pytest

from experiments.recorded import driving, figures, study, table
from experiments.recorded.driving import Drive
from experiments.recorded.study import RecordedStudy
from urbanjax.drivers import ConstantVelocity
from urbanjax.evaluation.collisions import Contact
from urbanjax.evaluation.recorded import goals, routes, scenes
from urbanjax.io.maps import Goal, PlanningProblem, Recording, Region, RoadMap
from urbanjax.planning.situation import SituationParams
from urbanjax.roadmap import matching
from urbanjax.roadmap.builders import straight
from urbanjax.roadmap.builders.specs import RoadStyle
from urbanjax.roadmap.corridor import CorridorParams, WindowParams
from urbanjax.rollout import LoopParams
from urbanjax.sim.world import SimParams
from urbanjax.stack import StackParams
from urbanjax.types import ConfigError, RouteError
from urbanjax.vehicle.params import VehicleParams

LEFT, RIGHT = 3.5, 0.0  # m, y of the lanes
STEPS = 41


def recording(rows, steps=STEPS, dt=0.1) -> Recording:
    """Vehicles (name, x, y, speed, first step, last step) that keep lane and speed, 4.8 m x 1.9 m."""
    t = np.arange(steps) * dt
    position = np.array([np.stack([x + v * t, np.full(steps, y)], 1) for _, x, y, v, *_ in rows]).transpose(1, 0, 2)
    count = len(rows)
    return Recording(
        dt=dt,
        ids=tuple(row[0] for row in rows),
        kind=("car",) * count,
        standing=np.zeros(count, bool),
        length=np.full(count, 4.8),
        width=np.full(count, 1.9),
        position=position,
        heading=np.zeros((steps, count)),
        speed=np.array([np.full(steps, row[3]) for row in rows]).T,
        valid=np.array([(np.arange(steps) >= row[4]) & (np.arange(steps) <= row[5]) for row in rows]).T,
    )


@pytest.fixture(scope="module")
def graph():
    return straight(2, 600.0, style=RoadStyle(lane_width=3.5, speed_limit=14.0, section=150.0))


@pytest.fixture(scope="module")
def road(graph, tmp_path_factory) -> RoadMap:
    rows = [
        ("ego", 60.0, RIGHT, 10.0, 0, 40),
        ("leader", 90.0, RIGHT, 10.0, 0, 40),
        ("late", 20.0, LEFT, 12.0, 8, 40),
        ("short", 200.0, LEFT, 5.0, 0, 12),
        ("one", 300.0, RIGHT, 5.0, 0, 40),
        ("two", 302.0, RIGHT, 5.0, 0, 40),
        ("outside", 60.0, -40.0, 5.0, 0, 40),
    ]
    path = tmp_path_factory.mktemp("road") / "made_up.xml"
    ids = tuple(range(graph.valid.shape[0]))
    return RoadMap(graph=graph, ids=ids, format="test", path=path, lanes=(), recording=recording(rows))


@pytest.fixture(scope="module")
def scene(road):
    return scenes.prepare(
        road.path.name, road.graph, recording=road.recording, params=CorridorParams(spacing=2.0), shortest=3.0
    )


def test_everybody_who_lasts_and_overlaps_nobody_is_replaced(scene):
    assert [start.name for start in scene.starts] == ["ego", "leader", "late"]
    assert scene.left_out.keys() == {"one", "two", "outside"}
    assert "overlaps two" in scene.left_out["one"]
    assert scene.left_out["outside"] == "leaves the map"


def test_a_start_is_the_recorded_vehicle_among_all_others(scene):
    late = scene.starts[2]
    assert (late.first, late.steps) == (8, 33)
    np.testing.assert_allclose(scene.ego.position[2], [20 + 9.6 - (0.5 - 0.2) * 4.8, LEFT], atol=1e-4)
    np.testing.assert_allclose(scene.ego.speed, [10, 10, 12])
    np.testing.assert_allclose(scene.vehicle.length, 4.8)
    valid = np.asarray(scene.replay.valid)
    for k, start in enumerate(scene.starts):
        assert not valid[k, :, start.index].any()
        others = np.arange(valid.shape[2]) != start.index
        np.testing.assert_array_equal(valid[k][:, others], scene.recording.valid[:, others])


def test_a_route_leads_on_and_changes_lanes_only_where_it_must(graph, scene):
    route = scene.starts[0].route
    links = np.asarray(route.link)[np.asarray(route.valid)]
    assert not np.asarray(route.change).any()
    assert links[0] == scene.starts[0].link
    assert float(graph.length[links].sum()) >= 300.0
    assert not np.asarray(routes.find_route(graph, 1, goals=(0, *routes.beside(graph, 0))).change).any()
    assert np.asarray(routes.find_route(graph, 1, goals=(0,)).change).sum() == 1
    with pytest.raises(RouteError, match=r"none of the links \[0\] can be reached from link 2"):
        routes.find_route(graph, 2, goals=(0,))


def test_matching_follows_a_lane_change_and_ignores_noise(graph):
    x = np.linspace(10, 400, 80)
    noise = 0.4 * np.sin(np.arange(80))
    y = np.where(x < 200, RIGHT, LEFT) + noise
    links = matching.match(graph, np.stack([x, y], 1), heading=np.zeros(80))
    expected = 2 * np.minimum(x // 150, 3).astype(int) + (x < 200)
    assert np.mean(links == expected) > 0.95
    assert matching.match(graph, np.array([[50.0, 30.0]]), heading=np.zeros(1)) is None


def test_nobody_to_replace_is_an_error(road):
    with pytest.raises(RouteError, match=r"made_up\.xml: nobody can be driven there"):
        scenes.prepare(road.path.name, road.graph, recording=road.recording, params=CorridorParams(), shortest=100.0)


def problem(goal: Goal, y=RIGHT) -> PlanningProblem:
    return PlanningProblem(5, (30.0, y), 0.0, 10.0, 0.0, (goal,))


def posed_in(road, task: PlanningProblem, params: CorridorParams, own: VehicleParams | None = None):
    return scenes.problems(
        road.path.name, road.graph, recording=road.recording, tasks=(task,), params=params, vehicle=own
    )


def test_a_planning_problem_is_driven_by_the_stacks_own_vehicle_to_its_goal(road):
    goal = Goal(regions=(Region((200.0, LEFT), length=10.0, width=3.0),), time=(0.0, 15.0))
    own = VehicleParams(length=5.5)
    posed = posed_in(road, problem(goal), CorridorParams(spacing=2.0), own)
    (start,) = posed.starts
    assert (start.index, start.first, start.steps, start.link) == (None, 0, 151, 1)
    assert np.asarray(start.route.change).sum() == 1
    assert bool(np.asarray(posed.replay.valid)[0].T[0].all())
    np.testing.assert_allclose(posed.vehicle.length, [5.5])
    np.testing.assert_allclose(posed.ego.position[0], [30.0 - own.centre_offset, RIGHT], atol=1e-5)
    with pytest.raises(RouteError, match="begins off the road"):
        posed_in(road, problem(goal, y=50.0), CorridorParams())


@pytest.mark.parametrize(
    ("goal", "reached"),
    [
        (Goal(regions=(Region((20.0, 0.0), length=4.0, width=2.0),)), True),
        (Goal(regions=(Region((20.0, 3.0), length=4.0, width=2.0),)), False),
        (Goal(regions=(Region((20.0, 0.5), radius=1.0),)), True),
        (Goal(regions=(Region((0.0, 0.0), corners=np.array([[18, -1], [22, -1], [20, 2]])),)), True),
        (Goal(regions=(Region((20.0, 0.0), length=4.0, width=2.0),), time=(0.0, 1.0)), False),
        (Goal(time=(1.9, 2.1), speed=(9.0, 11.0), heading=(-0.1, 0.1)), True),
        (Goal(heading=(3.0, 3.3)), False),
        (Goal(links=(1,)), True),
        (Goal(links=(0,)), False),
    ],
)
def test_a_goal_holds_where_all_that_it_names_holds(graph, scene, goal, reached):
    x = np.arange(41.0)
    path = np.stack([x, 0 * x, 0 * x], axis=1)
    start = dataclasses.replace(scene.starts[0], goals=(goal,))
    assert goals.reached(start, graph, path=path, speed=np.full(41, 10.0), period=0.1) == reached


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ConfigError, match=r"there is no a\.xml .*URBANJAX_DATA"):
        study.paths(RecordedStudy(folder=str(tmp_path), files=("a",)))


def test_the_stack_drives_among_them(scene):
    stack = StackParams()
    planning = stack.planning
    small = planning.replace(
        macro=planning.macro.replace(n_layers=8, nodes_per_lane=3),
        primitives=planning.primitives.replace(n_points=21, offsets=(-0.5, 0.0, 0.5), durations=(3.0,)),
    )
    stack = stack.replace(planning=small, situation=SituationParams(window=WindowParams(n_stations=128)))
    one = dataclasses.replace(
        scene,
        starts=scene.starts[:1],
        **{
            name: jax.tree.map(lambda x: x[:1], getattr(scene, name))
            for name in ("corridor", "replay", "ego", "vehicle")
        },
    )
    (found,) = driving.drive(LoopParams(stack=stack, sim=SimParams(n_objects=4)), one)
    assert found.reached is None
    assert found.contact == Contact.NONE
    assert not found.off_road
    assert found.human_way == pytest.approx(40.0, abs=0.5)
    assert 30.0 < found.way < 55.0
    assert len(found.speed) == STEPS
    np.testing.assert_allclose(found.path[0], [60.0, 0.0, 0.0], atol=0.05)


def test_who_keeps_its_speed_makes_the_way_of_one_who_did_to_the_last_step(graph):
    rows = [("ego", 60.0, RIGHT, 10.0, 0, 50), ("ahead", 95.0, RIGHT, 10.0, 0, 50)]
    known = recording(rows, steps=51)
    known.speed[:, 0] = 20.0  # at which the ego begins, and runs into who is ahead
    params = CorridorParams(spacing=2.0)
    scene = scenes.prepare("made_up", graph, recording=known, params=params, shortest=3.0)
    ego, ahead = driving.drive(LoopParams(driver=ConstantVelocity()), scene)
    assert [len(one.speed) for one in (ego, ahead)] == [51, 51]
    assert [one.way for one in (ego, ahead)] == pytest.approx([100.0, 50.0], abs=0.02)
    assert [one.human_way for one in (ego, ahead)] == pytest.approx([50.0, 50.0], abs=0.02)
    np.testing.assert_allclose(ahead.path, ahead.human_path, atol=0.01)
    assert (ahead.contact, ahead.contact_time) == (Contact.NONE, None)
    assert (ego.contact, ego.at_fault, ego.contact_with) == (Contact.FRONT, True, "ahead")
    assert ego.contact_time == pytest.approx((35.0 - 4.8) / 10.0, abs=0.1)


def made(scene="a", name="1", way=50.0, human=40.0, contact=Contact.NONE, at_fault=False, off=False, speed=None):
    """A drive on a straight line at 10 m/s beside a human who brakes at 1 m/s^2."""
    t = np.arange(11) * 0.1
    speed = np.full(11, 10.0) if speed is None else speed
    path = np.stack([10 * t, 0 * t, 0 * t], 1)
    touched = contact != Contact.NONE
    return Drive(
        scene,
        name,
        contact,
        at_fault,
        0.5 if touched else None,
        "7" if touched else None,
        off,
        way,
        human,
        path,
        speed,
        path + np.array([0, 1, 0]),
        10 - t,
        4.8,
        1.9,
        0.1,
    )


def test_scores_known_answers():
    drives = [
        made(),
        made(name="2", way=10.0, human=20.0),
        made(name="3", way=5.0, human=0.0, contact=Contact.REAR),
        made(name="4", way=15.0, human=15.0, contact=Contact.FRONT, at_fault=True, off=True),
    ]
    found = {name: value.value for name, value in table.score(drives).items()} | table.counts(drives)
    assert found["no_at_fault_collision_percent"] == 75
    assert found["other_contacts"] == 1
    assert found["off_road_percent"] == 25
    assert found["progress_percent"] == pytest.approx(100 * 80 / 75)
    assert found["progress_capped_percent"] == pytest.approx(100 * (1 + 0.5 + 1) / 3)
    assert found["acceleration_rms_mps2"] == 0
    assert found["human_acceleration_rms_mps2"] == pytest.approx(1)
    assert found["human_braking_p99_mps2"] == pytest.approx(1)
    safe = table.score(drives)["no_at_fault_collision_percent"]
    assert (safe.low, safe.high) == pytest.approx((30.06, 95.44), abs=0.01)
    wrong = table.failures(drives, {"a": {"9": "leaves the map"}})
    assert wrong["vehicle"] == ["3", "4", "4", "9"]
    assert wrong["what"] == ["not at fault", "at fault", "off the road", "left out"]
    assert "front contact with 7 after 0.5 s" in wrong["why"]


def test_figures_are_drawn(scene, tmp_path):
    drives = [made(), made(name="2", contact=Contact.FRONT, at_fault=True)]
    figures.draw_scene(scene, drives, tmp_path / "scene.png")
    figures.draw_summary(drives, tmp_path / "summary.png")
    assert all((tmp_path / name).stat().st_size > 5000 for name in ("scene.png", "summary.png"))
