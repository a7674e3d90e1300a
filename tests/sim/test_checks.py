"""A run that cannot begin is refused in one line, before anything is compiled."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.scenes import loop_params
from urbanjax import course, registration
from urbanjax.course import course_between
from urbanjax.roadmap.builders import straight
from urbanjax.rollout import rollout
from urbanjax.sim import lanes
from urbanjax.sim.checks import check_start
from urbanjax.sim.recording import Recording
from urbanjax.sim.replay import Replay
from urbanjax.sim.scenarios import follow, overtake
from urbanjax.types import CloudError, RoadError, RouteError, ScenarioError, as_arrays


@pytest.fixture(scope="module")
def run():
    """Arguments of a rollout that can begin."""
    params, family = as_arrays((loop_params(), overtake.OvertakeParams()))
    graph = straight(2, 300.0)
    start = overtake.sample(jax.random.key(0), family, vehicle=params.vehicle, others=params.sim.traffic).world
    return params, course_between(graph, 1, goal=1), lanes.from_graph(graph), start


def replay(steps=5, count=3, **changes) -> Replay:
    rows = {"position": (steps, count, 2), "heading": (steps, count), "speed": (steps, count), "length": (count,)}
    arrays = {name: jnp.ones(shape) for name, shape in rows.items()} | {"width": jnp.ones(count)}
    return Replay(**{**arrays, "valid": jnp.ones((steps, count), bool), "period": jnp.asarray(0.1), **changes})


def with_ego(start, **changes):
    return start.replace(ego=start.ego.replace(**changes))


BAD = {
    "position is not finite": (lambda s: with_ego(s, position=jnp.array([jnp.nan, 0.0])), r"position is \[nan"),
    "speed is not finite": (lambda s: with_ego(s, speed=jnp.asarray(jnp.inf)), "speed is inf"),
    "off the road": (lambda s: with_ego(s, position=jnp.array([60.0, 500.0])), r"\d+ m from the nearest lane"),
    "off the map": (lambda s: with_ego(s, position=jnp.array([-80.0, 0.0])), "80 m from the nearest lane"),
    "a batch": (lambda s: jax.tree.map(lambda x: jnp.stack([x, x]), s), r"shape \(2, 2\).*vmap it over a batch"),
    "no such link": (lambda s: s.replace(ego_link=jnp.asarray(9)), "ego_link is 9: the graph has 2 links"),
    "time": (lambda s: s.replace(time=jnp.asarray(jnp.nan)), "time is nan"),
    "vehicles first": (
        lambda s: s.replace(replay=replay(position=jnp.ones((3, 5, 2)))),
        r"replay.position has the shape \(3, 5, 2\).*T times by V",
    ),
    "backwards": (lambda s: with_ego(s, speed=jnp.asarray(-3.0)), "speed is -3 m/s: .* between 0 and 40"),
    "too fast": (lambda s: with_ego(s, speed=jnp.asarray(500.0)), "speed is 500 m/s"),
    "one length": (lambda s: s.replace(replay=replay(length=jnp.ones(()))), r"replay.length has the shape \(\)"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_start_that_cannot_be(run, name):
    params, way, tables, start = run
    change, message = BAD[name]
    with pytest.raises(ScenarioError, match=message) as caught:
        rollout(params, way, tables, change(start), 2)
    assert "\n" not in str(caught.value)


MISTAKES = {
    "graph": ({"graph": None}, "graph is a NoneType: give a RoadGraph"),
    "around a graph": ({"graph": "course"}, "graph is a Course: give a RoadGraph, here its .graph"),
    "start": ({"start": "a"}, "start link 'a' is not in the road graph"),
    "half": ({"start": 0.5}, "start link 0.5 is not"),
    "goal": ({"goal": None}, "goal link None is not"),
    "list": ({"goal": [0]}, r"goal link \[0\] is not"),
    "via": ({"via": 3}, "via is 3: give a tuple of links"),
    "text": ({"via": ("x",)}, "via link 'x' is not"),
    "laps": ({"laps": 1.5}, "laps is 1.5: it must be a whole number"),
    "many": ({"laps": 10**9}, "laps is 1000000000: it must be a whole number, between 1 and"),
    "route": ({"route": 3}, "route params is a int: give a RouteParams"),
    "corridor": ({"corridor": "x"}, "corridor is a str: give a CorridorParams"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_course_that_cannot_be(run, name, monkeypatch):
    monkeypatch.setattr(course, "route_between", course.route_between.__wrapped__)
    change, message = MISTAKES[name]
    given = {"graph": run[1].graph, "start": 1, "goal": 1, **change}
    given["graph"] = run[1] if given["graph"] == "course" else given["graph"]
    with pytest.raises(RouteError, match=message) as caught:
        course_between.__wrapped__(given.pop("graph"), given.pop("start"), **given)
    assert "\n" not in str(caught.value)


def test_what_is_no_drive(run):
    params = run[0]
    batch = params.replace(vehicle=jax.tree.map(lambda x: jnp.stack([x, x]), params.vehicle))
    with pytest.raises(ScenarioError, match="params hold a batch"):
        rollout(batch, *run[1:], 2)
    for more, message in (({"keep": 3}, "keep is 3: give a function"), ({"sensing": "x"}, "sensing is a str: give")):
        with pytest.raises(ScenarioError, match=message):
            rollout.__wrapped__(*run, 2, **more)
    for wrong in (None, 3):
        with pytest.raises(RoadError, match=r"graph is a .*: give a RoadGraph"):
            lanes.from_graph.__wrapped__(wrong)
    with pytest.raises(RoadError, match=r"here its \.graph"):
        lanes.from_graph.__wrapped__(run[1])


@pytest.mark.parametrize("family", [overtake, follow])
def test_what_no_start_can_be_drawn_from(family):
    with pytest.raises(ScenarioError, match="params is a NoneType: give a"):
        family.road.__wrapped__(None)
    with pytest.raises(ScenarioError, match="key is a NoneType: give a"):
        family.sample.__wrapped__(None, None, vehicle=None, others=None)


def test_no_steps(run):
    with pytest.raises(ScenarioError, match="n_steps is 0"):
        rollout(*run, 0)


def test_a_start_far_from_its_route(run):
    _params, way, tables, start = run
    astray = with_ego(start, position=jnp.array([250.0, 0.0]))
    far = way.corridor.replace(valid=way.corridor.station < 100.0)
    with pytest.raises(ScenarioError, match="from the course's route"):
        check_start(tables.graph, far, world=astray)


def test_inside_jit_only_shapes_are_looked_at(run):
    _, course, tables, start = run
    wrong = with_ego(start, position=jnp.array([jnp.nan, 0.0]))
    jax.jit(lambda s: check_start(tables.graph, course.corridor, world=s))(wrong)
    with pytest.raises(ScenarioError, match=r"replay\.position has the shape"):
        jax.jit(lambda s: check_start(tables.graph, course.corridor, world=s))(
            start.replace(replay=replay(heading=jnp.ones(3)))
        )


def test_what_can_begin_is_let_through(run):
    _, course, tables, start = run
    check_start(tables.graph, course.corridor, world=start.replace(replay=replay()))


@pytest.mark.parametrize(("name", "shape"), [("position", (3, 5, 2)), ("heading", (3, 5)), ("length", (5,))])
def test_a_recording_with_vehicles_first_is_refused(name, shape):
    rows = {"position": (5, 3, 2), "heading": (5, 3), "speed": (5, 3), "length": (3,), "width": (3,), "standing": (3,)}
    arrays = {key: np.zeros(shape if key == name else right) for key, right in rows.items()}
    with pytest.raises(ScenarioError, match=rf"Recording.{name} has the shape"):
        Recording(dt=0.1, ids=(1, 2, 3), kind=("car",) * 3, valid=np.ones((5, 3), bool), **arrays)


@pytest.mark.parametrize(
    ("points", "given", "message"),
    [
        (np.zeros((3, 50)), {}, r"position has the shape \(3, 50\)"),
        (np.zeros((50, 3)), {"valid": np.ones(49, bool)}, r"valid has the shape \(49,\)"),
        (np.zeros((50, 3)), {"covariance": np.zeros((50, 6))}, r"covariance has the shape \(50, 6\)"),
        (np.full((50, 3), np.nan), {}, "not finite"),
    ],
)
def test_a_cloud_of_another_shape_is_refused(points, given, message):
    """Called past the suite's own check of shapes, as a user calls it."""
    bare = registration.cloud.__wrapped__
    arrays = {name: jnp.asarray(values) for name, values in given.items()}
    with pytest.raises(CloudError, match=message):
        bare(jnp.asarray(points, jnp.float32), **arrays)


def test_points_that_do_not_count_may_be_anything():
    points = jnp.full((50, 3), jnp.nan).at[:20].set(1.0)
    assert int(registration.cloud(points, valid=jnp.arange(50) < 20).valid.sum()) == 20
