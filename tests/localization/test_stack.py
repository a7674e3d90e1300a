"""The stack on a localizer of its own: it brakes where the pose is lost, and drives where it believes to be."""

import jax
import jax.numpy as jnp
import jaxlie
import numpy as np
import pytest

from tests.scenes import loop_params
from urbanjax import stack
from urbanjax.course import course_between
from urbanjax.localization.types import Health, Localization
from urbanjax.rollout import rollout
from urbanjax.sim import lanes as tables
from urbanjax.sim.scenarios import overtake
from urbanjax.sim.scenarios.overtake import OvertakeParams
from urbanjax.sim.sensing import Sensing
from urbanjax.types import ScenarioError, as_arrays


@pytest.mark.parametrize("health", list(Health))
def test_a_lost_pose_stops_the_vehicle(health):
    located = Localization(jaxlie.SE2.identity(), jnp.eye(3), jnp.asarray(int(health)))
    share = float(located.brake(jnp.asarray(0.25)))
    assert share == (1.0 if health == Health.STOP else 0.25)


def test_without_a_map_the_localizer_says_what_it_needs(street):
    params = loop_params()
    params = as_arrays(params.replace(stack=params.stack.replace(localizer="lidar", lidar=street.localizer)))
    course = course_between(street.graph, 1, goal=1)
    state = stack.init(params.handed_down()[0], course, street.ego(60.0).pose)
    with pytest.raises(ScenarioError, match=r"course\.map"):
        stack.step(params.handed_down()[0], course, state, street.observe(street.ego(60.0), 0))
    seen = street.observe(street.ego(60.0), 0)
    with pytest.raises(ScenarioError, match=r"course\.map"):
        stack.recover(params.handed_down()[0], course, state=state, observation=seen)


@pytest.mark.slow
def test_closed_loop_on_poses_from_scans(street):
    """From scan to steering for five seconds behind a slow vehicle: the pose holds, nobody is hit."""
    params = loop_params()
    params = params.replace(
        stack=params.stack.replace(localizer="lidar", lidar=street.localizer),
        sensor=street.sensor,
    )
    params, family = as_arrays((params, OvertakeParams(start=40.0, length=200.0, crowded=0.0)))
    course = course_between(street.graph, 1, goal=1).replace(map=street.map)
    lanes = tables.from_graph(street.graph)
    start = overtake.sample(jax.random.key(2), family, vehicle=params.vehicle, others=params.sim.traffic).world
    sensing = Sensing(street.surroundings, jax.random.key(5))

    def keep(info):
        return info.localization.pose.translation(), info.localization.health

    log, (estimate, health) = jax.jit(lambda now: rollout(params, course, lanes, now, 50, keep=keep, sensing=sensing))(
        start
    )
    away = np.linalg.norm(np.asarray(estimate) - np.asarray(log.ego.position), axis=1)
    assert away.max() < 0.2
    assert np.all(np.asarray(health) == Health.NORMAL)
    assert float(log.ego.position[-1, 0]) > float(log.ego.position[0, 0]) + 25.0
    gap = np.linalg.norm(np.asarray(log.traffic.position)[:, 0] - np.asarray(log.centre), axis=1)
    assert gap.min() > 2.5
