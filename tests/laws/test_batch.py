"""A batch of closed loops is the same as the loops one by one, and nothing compiles once the first step has run.

The single loops are optimised as a user's are, the batch is not (conftest): optimisation changes nothing either.
"""

import jax
import numpy as np
import pytest

from tests.scenes import loop_params, overtake_scene
from urbanjax import compiler_options, stack
from urbanjax.rollout import rollout
from urbanjax.sim import world
from urbanjax.types import as_arrays

N_STEPS = 20
OPTIMISED = {"xla_backend_optimization_level": 3, "xla_disable_hlo_passes": ""}


@pytest.mark.parametrize("n_starts", [6, pytest.param(64, marks=pytest.mark.slow)])
def test_a_batch_equals_single_runs(n_starts):
    with jax.enable_x64(True):
        params = as_arrays(loop_params())
        course, lanes, starts = map(as_arrays, overtake_scene(params, n_starts))
        starts = jax.device_get(starts)

        def drive(start):
            log, _ = rollout(params, course, lanes, start, N_STEPS)
            return log.ego

        batch = jax.device_get(jax.jit(jax.vmap(drive))(starts))
        single = jax.jit(drive, compiler_options=OPTIMISED | compiler_options())
        for i in range(n_starts):
            alone = single(jax.tree.map(lambda x, i=i: x[i], starts))
            for one, many in zip(jax.tree.leaves(alone), jax.tree.leaves(batch), strict=True):
                np.testing.assert_allclose(many[i], one, rtol=0, atol=1e-9)


@pytest.mark.slow  # so does io/bridges/highway/test_driver.py, by default
def test_nothing_compiles_after_the_first_step():
    params = as_arrays(loop_params())
    course, lanes, starts = map(as_arrays, overtake_scene(params, 2))
    first, second = (jax.tree.map(lambda x, i=i: x[i], starts) for i in range(2))
    driver, sim = params.handed_down()
    begin, step = jax.jit(stack.init), jax.jit(stack.step)
    move = jax.jit(lambda now, command: world.step(sim, lanes, now, command, params.period))
    see = jax.jit(lambda now: world.observe(sim, lanes, world=now))
    compiled = []

    def count(event: str, duration: float, **_: object) -> None:
        if event == "/jax/core/compile/backend_compile_duration":
            compiled.append(event)

    def drive(now, n_steps: int) -> None:
        state = begin(driver, course, now.ego.pose)
        for _ in range(n_steps):
            command, state, _ = step(driver, course, state, see(now))
            now = move(now, command)

    jax.monitoring.register_event_duration_secs_listener(count)
    try:
        drive(first, 1)
        by_the_first_step = len(compiled)
        drive(first, 4)
        drive(second, 4)
    finally:
        jax.monitoring.unregister_event_duration_listener(count)
    assert by_the_first_step > 0, "the listener heard no compilation at all"
    assert len(compiled) == by_the_first_step
