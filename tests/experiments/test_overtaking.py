"""The drives of the overtaking study are closed loops from its starts, of any duration."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.common import overtaking
from experiments.common.overtaking import OvertakeStudy
from tests.scenes import loop_params
from urbanjax import compiler_options
from urbanjax.course import course_between
from urbanjax.evaluation import metrics
from urbanjax.rollout import rollout
from urbanjax.sim import lanes
from urbanjax.sim.scenarios import overtake
from urbanjax.types import ConfigError, as_arrays, with_values

LOOP = loop_params()
STEPS = 53  # no multiple of what is driven between two looks
STUDY = OvertakeStudy(
    stack=LOOP.stack,
    sim=LOOP.sim,
    scenario=overtake.OvertakeParams(length=400.0),
    taus=(0.0, 1.0),
    starts=2,
    duration=0.1 * STEPS,
)


@pytest.mark.slow
def test_the_study_is_its_rollouts_one_by_one(x64):
    """The road, the starts and the params are put together by hand here. In float64: in float32 close calls differ."""
    found, seconds = overtaking.drive(STUDY)
    road = overtake.road(STUDY.scenario)
    course, tables = course_between(road, overtake.RIGHT, goal=overtake.RIGHT), lanes.from_graph(road)
    keys = jax.random.split(jax.random.key(STUDY.seed), STUDY.starts)
    told = as_arrays({"vehicle": STUDY.vehicle, "others": STUDY.sim.traffic})
    params = as_arrays(STUDY.scenario)
    drive = jax.jit(
        lambda loop, start: rollout(loop, course, tables, start, STEPS)[0], compiler_options=compiler_options()
    )
    logs = {}
    for a, clamp, k in ((0, 0, 0), (0, 1, 1), (1, 0, 1), (1, 1, 0)):
        clamp_time = (STUDY.stack.behavior.gvp.clamp_time, overtaking.NO_CLAMP)[clamp]
        gvp = {"stack.behavior.gvp.tau": STUDY.taus[a], "stack.behavior.gvp.clamp_time": clamp_time}
        scenario = overtake.sample(keys[k], params, **told)
        assert bool(found.crowded[k]) == bool(scenario.crowded)
        logs[a, clamp, k] = jax.device_get(drive(as_arrays(with_values(STUDY.loop(), gvp)), scenario.world))
    assert found.speed.shape == (2, 2, 2, STEPS)
    assert seconds["run_s"] > 0
    for place, log in logs.items():
        path = np.column_stack([log.centre, log.ego.heading])
        np.testing.assert_allclose(found.ego[place], path, atol=1e-6)
        np.testing.assert_allclose(found.speed[place], log.ego.speed, atol=1e-6)
        np.testing.assert_allclose(found.others[place][..., :2], log.traffic.position, atol=1e-6)
        np.testing.assert_allclose(found.time, log.time, atol=1e-9)
        one = metrics.evaluate(jax.tree.map(jnp.asarray, log))
        assert found.progress[place] == pytest.approx(float(one.progress), abs=1e-6)
        assert found.drop[place] == pytest.approx(float(one.speed_drop), abs=1e-6)
        assert found.collided[place] == (float(one.collision) > 0.5)
    assert np.abs(found.progress[1] - found.progress[0]).max() > 0.1  # the sets are told apart


def test_sets_are_every_tau_with_the_clamp_and_without():
    """Of the shape in which results are read, [A, 2]."""
    found = [loop.stack.behavior.gvp for loop in overtaking.sets_of(STUDY)]
    clamp_time = STUDY.stack.behavior.gvp.clamp_time
    assert [gvp.tau for gvp in found] == [0.0, 0.0, 1.0, 1.0]
    assert [gvp.clamp_time for gvp in found] == [clamp_time, overtaking.NO_CLAMP] * 2


def test_a_drive_lasts_as_long_as_is_said():
    assert overtaking.mission_of(dataclasses.replace(STUDY, duration=47.0)).longest == pytest.approx(47.0)
    with pytest.raises(ConfigError, match="'duration' is 0\\.1 s"):
        overtaking.mission_of(dataclasses.replace(STUDY, duration=0.1))
