"""What a field states of its values holds for whoever makes the params; JAX may put anything in their place."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax import LoopParams
from urbanjax.behavior.gvp import GVPParams
from urbanjax.registration import MapParams
from urbanjax.sim.scenarios.overtake import OvertakeParams
from urbanjax.traffic.course.sections import SectionParams
from urbanjax.traffic.divergence.estimate import DivergenceParams
from urbanjax.traffic.resampling import ResamplingParams
from urbanjax.types import ConfigError, as_arrays, field, pytree

MISTAKES = {
    "choice": (lambda: MapParams(method="icp"), "MapParams.method is 'icp': use one of vgicp, ndt, gicp"),
    "another": (lambda: DivergenceParams(form="foo"), "DivergenceParams.form is 'foo': use one of .*"),
    "nothing": (lambda: MapParams(method=None), "MapParams.method is None: use one of .*"),
    "number": (lambda: GVPParams(tau=7.0), "GVPParams.tau is 7.0: it must be between 0 and 1"),
    "whole number": (lambda: GVPParams(tau=7), "GVPParams.tau is 7: it must be between 0 and 1"),
    "replaced": (lambda: GVPParams().replace(tau=-0.5), "GVPParams.tau is -0.5: it must be between 0 and 1"),
    "not a number": (lambda: GVPParams(tau=float("nan")), "GVPParams.tau is nan: it must be between 0 and 1"),
    "NumPy's": (lambda: GVPParams(tau=np.float32(2)), "GVPParams.tau is 2.0: it must be between 0 and 1"),
    "one of a batch": (lambda: GVPParams(tau=np.array([0.5, 2.0])), "GVPParams.tau is 2.0: it must be between 0 and 1"),
    "zero": (lambda: LoopParams(period=0), "LoopParams.period is 0: it must be positive"),
    "share": (lambda: OvertakeParams(crowded=1.5), "OvertakeParams.crowded is 1.5: it must be between 0 and 1"),
    "text for a number": (lambda: LoopParams(period="x"), "LoopParams.period is 'x': it must be a number"),
    "number for a record": (lambda: LoopParams(vehicle=3), "LoopParams.vehicle is 3: it must be a VehicleParams"),
    "another record": (lambda: LoopParams(stack=GVPParams()), "LoopParams.stack is GVP.*: it must be a StackParams"),
    "text for a count": (lambda: ResamplingParams(draws="x"), "draws is 'x': it must be a whole number"),
    "no count": (lambda: ResamplingParams(draws=None), "draws is None: it must be a whole number"),
    "number for a tuple": (lambda: DivergenceParams(ks=5), "ks is 5: it must be a tuple"),
    "texts in a tuple": (lambda: DivergenceParams(ks=("x",)), "ks is .*: it must be a tuple, of which each is a whole"),
    "choice of no kind": (lambda: DivergenceParams(form=[]), r"form is \[\]: use one of .*"),
    "open range": (lambda: ResamplingParams(level=0.0), "level is 0.0: it must be above 0 and below 1"),
    "greater": (lambda: SectionParams(window=0.0), "SectionParams.window is 0.0: it must be between 0.1 and 10000"),
}


@pytest.mark.parametrize(("make", "message"), MISTAKES.values(), ids=MISTAKES)
def test_a_value_that_its_field_excludes_is_refused(make, message):
    with pytest.raises(ConfigError, match=message):
        make()


def test_each_of_several_values_is_looked_at_also_in_a_class_that_adds_to_another():
    @pytree
    class Grid(LoopParams):
        taus: tuple[float, ...] = field(default=(0.0,), metadata={"range": (0.0, 1.0)})

    assert Grid(taus=(0.0, 1.0)).taus == (0.0, 1.0)
    with pytest.raises(ConfigError, match=r"Grid.taus is 1.5: it must be between 0 and 1"):
        Grid(taus=(0.5, 1.5))
    with pytest.raises(ConfigError, match=r"Grid.period is -0.1: it must be positive"):
        Grid(period=-0.1)


def test_what_jax_puts_in_the_place_of_values_is_not_looked_at():
    params, sentinel = LoopParams(), object()
    leaves, structure = jax.tree.flatten(params)
    assert jax.tree.unflatten(structure, leaves) == params
    assert jax.tree.unflatten(structure, [sentinel] * len(leaves)).stack.behavior.gvp.tau is sentinel
    axes = jax.tree.map(lambda _: None, params)
    assert axes.period is None
    assert jax.tree.map(lambda _: 0, params).period == 0
    away = jax.tree.map(lambda leaf: -10.0 * leaf, params)
    assert away.period == -1.0
    assert GVPParams(tau=None).tau is None
    assert LoopParams(vehicle=None, period=sentinel, stack=sentinel).stack is sentinel


def test_traced_and_batched_values_pass():
    def through(tau):
        return GVPParams(tau=tau).tau

    assert jax.jit(through)(2.0) == 2.0
    assert jax.grad(through)(0.5) == 1.0
    assert jax.vmap(through)(jnp.arange(3.0)).shape == (3,)
    arrays = as_arrays(GVPParams())
    assert jax.grad(lambda params: -3.0 * params.tau)(arrays).tau == -3.0
    assert arrays.replace(tau=jnp.asarray(2.0)).tau == 2.0  # looking at it would wait for the device


def test_leaves_are_named_by_their_fields():
    paths = {jax.tree_util.keystr(path) for path, _ in jax.tree_util.tree_flatten_with_path(LoopParams())[0]}
    assert ".stack.behavior.gvp.tau" in paths
    assert ".sensor.pattern" not in paths


@pytest.mark.parametrize(("tree", "dtype"), [("x", None), (GVPParams(), "x"), (GVPParams(), int), ({"a": {1}}, None)])
def test_what_no_arrays_can_be_made_of(tree, dtype):
    with pytest.raises(ConfigError, match=r"no number|dtype is .*: give one of floats"):
        as_arrays(tree, dtype)
