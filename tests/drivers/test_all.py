"""Laws of all drivers: what they say in one step of a free road, and 14 m behind somebody who stands."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.scenes import course_along, loop_params, one_shape
from urbanjax import stack
from urbanjax.drivers import DRIVERS
from urbanjax.roadmap.builders import RoadStyle, straight
from urbanjax.sim import lanes as tables
from urbanjax.sim import world as worlds
from urbanjax.sim.scenarios.scenario import ego_at, traffic, world
from urbanjax.types import Command, as_arrays

LIMIT, SPEED, START, LENGTH = 14.0, 12.0, 20.0, 4.7
FRONT = LENGTH - 0.95  # m, before the rear axle
# What each says on the free road and behind who stands: the least and the most acceleration [m/s^2].
SAYS = {
    "stack": ((0.1, 2.5), (-6.0, -0.5)),
    "standstill": ((-6.0, -6.0), (-6.0, -6.0)),
    "constant_velocity": ((0.0, 0.0), (0.0, 0.0)),
    "blind": ((0.1, 2.5), (0.1, 2.5)),
    "idm": ((0.1, 2.5), (-6.0, -3.0)),
    "pdm": ((0.1, 1.5), (-6.0, -6.0)),
}


@pytest.fixture(scope="module")
def scene():
    """Course, pose and the observations of the free road and of somebody who stands, stacked."""
    graph = one_shape(straight(2, 500.0, style=RoadStyle(lane_width=3.5, speed_limit=LIMIT)))
    course, lanes = course_along(graph, 1, 1), tables.from_graph(graph)
    _, sim = loop_params().handed_down()
    ego = ego_at(jnp.asarray(START), graph.centre[1, 0, 1] + 0.2, speed=jnp.asarray(SPEED))

    def see(there):
        one = jnp.ones(1)
        others = traffic(
            jnp.ones(1, jnp.int32),
            one * (START + FRONT + 14.0 + LENGTH / 2),
            speed=0 * one,
            limit=LIMIT,
            params=sim.traffic,
            valid=there[None],
        )
        now = world(ego, 1, vehicles=others)
        return worlds.observe(sim, lanes, world=now, seen=worlds.look(sim, lanes, world=now))

    return course, ego.pose, jax.jit(jax.vmap(see))(jnp.array([False, True]))


@pytest.fixture(scope="module")
def said(scene):
    """State before, command, state after and driver, by name; the stack is compiled once for those who use it."""
    course, pose, seen = scene
    quick = jax.jit(stack.step)
    found = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stack, "step", quick)
        for name, kind in DRIVERS.items():
            made = loop_params().stack if name == "stack" else kind()
            if name == "blind":
                made = made.replace(stack=loop_params().stack)
            driver = as_arrays(loop_params().replace(driver=made).handed_down()[0])
            before = jax.jit(driver.init)(course, pose)
            step = driver.step if name in ("stack", "blind") else jax.jit(driver.step)
            both = [step(course, before, jax.tree.map(lambda x, i=i: x[i], seen))[:2] for i in range(2)]
            command, after = jax.tree.map(lambda *x: jnp.stack(x), *both)
            found[name] = jax.device_get((before, command, after)), driver
    return found


@pytest.mark.parametrize("name", DRIVERS)
def test_a_driver_says_what_it_is_for(said, name):
    (_, command, _), driver = said[name]
    assert isinstance(command, Command)
    for acceleration, (least, most) in zip(command.acceleration, SAYS[name], strict=True):
        assert least - 1e-4 <= acceleration <= most + 1e-4
    if name in ("standstill", "constant_velocity"):
        assert (command.steering == 0).all()
    else:
        assert (command.steering < 0).all()  # back to the middle of its lane
        assert (command.steering > -float(driver.vehicle.max_steering)).all()


@pytest.mark.parametrize("name", DRIVERS)
def test_what_a_driver_remembers_is_of_one_shape(said, name):
    (before, _, after), _ = said[name]
    assert jax.tree.structure(before) == jax.tree.structure(after)
    for one, other in zip(jax.tree.leaves(before), jax.tree.leaves(after), strict=True):
        assert np.shape(one) == np.shape(other)[1:]
        assert np.asarray(one).dtype == np.asarray(other).dtype


def test_drivers_begin_where_the_ego_is(said):
    for name in ("idm", "pdm"):
        (before, _, after), _ = said[name]
        np.testing.assert_allclose([before, *after], START, atol=1e-3)
    (stack_begins, *_), _ = said["stack"]
    (blind_begins, *_), _ = said["blind"]
    assert stack_begins.station == pytest.approx(START, abs=1e-3)
    for one, other in zip(jax.tree.leaves(stack_begins), jax.tree.leaves(blind_begins), strict=True):
        np.testing.assert_array_equal(one, other)


def test_no_two_drivers_are_the_same(said):
    says = {name: tuple(np.round(kept[1].acceleration, 3)) for name, (kept, _) in said.items()}
    assert SAYS.keys() == says.keys()
    assert len(set(says.values())) == len(says)
