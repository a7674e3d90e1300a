"""A run that cannot begin is refused in one line, before anything is compiled."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.scenes import loop_params
from urbanjax import registration
from urbanjax.course import course_between
from urbanjax.roadmap.builders import straight
from urbanjax.rollout import rollout
from urbanjax.sim import lanes
from urbanjax.sim.checks import check_start
from urbanjax.sim.recording import Recording
from urbanjax.sim.replay import Replay
from urbanjax.sim.scenarios import overtake
from urbanjax.types import CloudError, ScenarioError, as_arrays


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
    "one length": (lambda s: s.replace(replay=replay(length=jnp.ones(()))), r"replay.length has the shape \(\)"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_start_that_cannot_be(run, name):
    params, course, tables, start = run
    change, message = BAD[name]
    with pytest.raises(ScenarioError, match=message) as caught:
        rollout(params, course, tables, change(start), 2)
    assert "\n" not in str(caught.value)


def test_no_steps(run):
    with pytest.raises(ScenarioError, match="n_steps is 0"):
        rollout(*run, 0)


def test_a_start_far_from_its_route(run):
    _params, course, tables, start = run
    astray = with_ego(start, position=jnp.array([250.0, 0.0]))
    far = course.corridor.replace(valid=course.corridor.station < 100.0)
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
