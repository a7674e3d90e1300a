"""From a map to a drive on it by the ids of the map, and to a picture of the drive."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.io.maps import texts
from tests.scenes import loop_params
from urbanjax.evaluation import evaluate, score, tracks
from urbanjax.io import figures, maps
from urbanjax.roadmap.builders import straight
from urbanjax.sim import log as sim_log
from urbanjax.types import FileError, RouteError, ScenarioError, UrbanJaxError
from urbanjax.vehicle.params import VehicleParams


@pytest.fixture(scope="module")
def road(tmp_path_factory):
    path = tmp_path_factory.mktemp("maps") / "crossing.xml"
    path.write_text(texts.COMMONROAD)
    return maps.read(path)


@pytest.fixture(scope="module")
def driven(road):
    scene = maps.scene(road, vehicle=100, duration=0.4, params=loop_params())
    return scene, jax.device_get(scene.drive())


def test_a_planning_problem_is_named_by_its_place_or_its_id(road):
    by_place, by_id, first = (
        maps.scene(road, **given) for given in ({"problem": 0}, {"problem": road.problems[0].id}, {})
    )
    assert by_place.name == by_id.name == first.name == f"crossing, problem {road.problems[0].id}"
    np.testing.assert_array_equal(by_id.start.ego.position, by_place.start.ego.position)
    problem, offset = road.problems[0], float(VehicleParams().centre_offset)
    ahead = np.array([np.cos(problem.heading), np.sin(problem.heading)])
    np.testing.assert_allclose(by_place.start.ego.position + offset * ahead, problem.position, atol=1e-5)
    assert float(by_place.start.ego.speed) == problem.speed
    assert by_place.n_steps == 1 + round(max(goal.time[1] for goal in problem.goals if goal.time) / 0.1)


def test_a_recorded_vehicle_is_replaced_and_keeps_its_size(road, driven):
    scene, log = driven
    assert scene.name == "crossing, 100"
    assert float(scene.params.vehicle.length) == 4.5
    assert log.time.shape == (5,)
    np.testing.assert_allclose(log.centre[0], road.recording.position[0, 0], atol=1e-4)
    standing = log.traffic.valid[0] & (np.abs(log.traffic.speed[0]) < 1e-6)
    assert standing.sum() == 1  # the parked one; the replaced one is gone
    assert log.traffic.valid[0].sum() == 1
    assert scene.reached(log) is None


def test_metrics_and_score_need_nothing_but_the_log(driven):
    log = jax.tree.map(jnp.asarray, driven[1])
    assert float(evaluate(log).collision) == 0
    assert float(evaluate(log, VehicleParams()).progress) == float(evaluate(log).progress) > 1
    assert np.isfinite(float(score(log)))


def test_a_picture_of_the_drive(driven, road, tmp_path):
    scene, log = driven
    for k, known in enumerate((scene, road, road.graph)):
        path = figures.drive(log, known, path=tmp_path / f"{k}.png")
        assert path.stat().st_size > 20_000
    with pytest.raises(ScenarioError, match=r"log\.time has the shape \(2, 5\).*one run"):
        figures.drive(jax.tree.map(lambda x: np.stack([x, x]), log), road, path=tmp_path / "batch.png")


def test_a_path_that_no_picture_can_have_is_refused(driven, tmp_path):
    scene, log = driven
    assert figures.drive(log, scene, path=tmp_path / "plain") == tmp_path / "plain.png"
    for path, message in (
        ("", "no name"),
        (tmp_path, "no name"),
        (tmp_path / "x.doc", "no name"),
        (tmp_path / "no" / "x.png", "no folder"),
        ("x" * 400, "400 characters"),
        ("a\0b.png", "zero byte"),
        ("/proc/x.png", "cannot be written"),
    ):
        with pytest.raises(FileError, match=message):
            figures.drive(log, scene, path=path)


def test_a_map_of_another_place_is_refused(driven, tmp_path):
    scattered = straight(1, 900.0)
    scattered = scattered.replace(centre=scattered.centre + 300.0)
    with pytest.raises(ScenarioError, match="give the map that was driven on"):
        figures.drive(driven[1], scattered, path=tmp_path / "x.png")


def test_everybody_is_named_and_the_ego_comes_first(driven):
    scene, log = driven
    everybody = tracks(jax.tree.map(jnp.asarray, log), scene.params.vehicle)
    assert scene.names == ("ego", "nobody", "100", "101")
    assert everybody.valid[0].tolist() == [True, False, False, True]
    np.testing.assert_array_equal(everybody.position[:, 0], log.centre)
    np.testing.assert_array_equal(everybody.position[:, 1:], log.traffic.position)


def test_other_params_are_checked_as_the_scenes_own_are(driven):
    scene, _ = driven
    with pytest.raises(ScenarioError, match=r"recorded every 0\.1 s"):
        scene.drive(scene.params.replace(period=0.2))
    batch = scene.params.replace(vehicle=jax.tree.map(lambda x: jnp.stack([x, x]), scene.params.vehicle))
    with pytest.raises(ScenarioError, match="params hold a batch"):
        scene.drive(batch)


def test_what_is_no_log_of_the_drive(road, driven, monkeypatch):
    monkeypatch.setitem(maps.Scene.reached.__wrapped__.__globals__, "check", sim_log.check.__wrapped__)
    scene = maps.scene(road, problem=np.int64(0))
    log = driven[1]
    unknown = log.replace(ego=log.ego.replace(speed=log.ego.speed * np.nan))
    batch, empty = jax.tree.map(lambda x: np.stack([x, x]), log), jax.tree.map(lambda x: x[:0], log)
    for wrong, message in (
        (None, "log is a NoneType"),
        (3, "log is a int"),
        (batch, "one run"),
        (empty, "two steps or more"),
        (unknown, "not finite"),
    ):
        with pytest.raises(ScenarioError, match=message):
            maps.Scene.reached.__wrapped__(scene, wrong)


def test_what_no_scene_can_be_of(road, driven):
    with pytest.raises(ScenarioError, match=r"'duration' is 1e\+09 s, and a drive may last 10000 s"):
        maps.scene(road, lane=2, duration=1e9)
    batch = driven[0].params.vehicle
    params = loop_params().replace(vehicle=jax.tree.map(lambda x: jnp.stack([x, x]), batch))
    with pytest.raises(ScenarioError, match="params hold a batch"):
        maps.scene(road, params=params)


def test_from_lane_to_lane(road):
    there = maps.scene(road, lane=2, goal=4, duration=2.0)
    links = np.asarray(there.ego.route.link)[np.asarray(there.ego.route.valid)]
    assert [road.ids[link] for link in links] == [2, 4]
    assert (float(there.start.ego.speed), there.n_steps) == (0.0, 21)
    begin = np.asarray(road.graph.centre)[road.link(2), 0] - np.array([float(VehicleParams().centre_offset), 0])
    np.testing.assert_allclose(there.start.ego.position, begin, atol=1e-4)


@pytest.mark.filterwarnings("ignore::urbanjax.io.maps.DanglingWarning")
@pytest.mark.parametrize("text", [texts.lanelet2(), texts.SUMO], ids=["lanelet2", "sumo"])
def test_maps_without_traffic(text, tmp_path):
    path = tmp_path / "map.xml"
    path.write_text(text)
    found = maps.read(path)
    scene = maps.scene(path, lane=found.ids[0])
    assert scene.start.replay is None
    assert scene.n_steps == 201
    with pytest.raises(ScenarioError, match="no planning problem; give 'lane'"):
        maps.scene(found)
    with pytest.raises(ScenarioError, match="no recorded vehicle; give 'lane'"):
        maps.scene(found, vehicle=3)


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ({"vehicle": 7}, ScenarioError, "no recorded vehicle is 7; there are 100, 101"),
        ({"vehicle": 101}, ScenarioError, "101 does not move"),
        ({"problem": 7}, ScenarioError, r"no planning problem is 7; there are \d+"),
        ({"problem": 0, "vehicle": 100}, ScenarioError, "give one of"),
        ({"goal": 4}, ScenarioError, "'goal' belongs to 'lane'"),
        ({"lane": 77}, UrbanJaxError, "no lane is 77; there are 1, 2"),
        ({"lane": 3, "goal": 5}, RouteError, "lane 5 cannot be reached from lane 3"),
        ({"problem": 0, "duration": float("nan")}, ScenarioError, "duration is nan"),
        ({"problem": 0, "duration": 0.01}, ScenarioError, "longer 'duration'"),
        ({"problem": 0, "duration": 0.0}, ScenarioError, "duration is 0.0: it must be a positive number"),
        ({"problem": 0, "params": loop_params().replace(period=0.2)}, ScenarioError, "recorded every 0.1 s"),
    ],
)
def test_what_the_map_does_not_have_is_said_in_one_line(road, given, error, message):
    with pytest.raises(error, match=message) as caught:
        maps.scene(road, **given)
    assert "\n" not in str(caught.value)
