"""A vector of free coordinates stands for params: z = 0 for those one starts from, and no z for what may not be."""

import math
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.io.runs.parameter_file import read_parameters, write_parameters
from urbanjax.planning.learned import initial
from urbanjax.planning.micro import MICRO_TERMS
from urbanjax.rollout import LoopParams
from urbanjax.tuning import Space, space, trainables
from urbanjax.tuning.spaces import ELEMENT
from urbanjax.types import INSIDE, POSITIVE, SHARE, ConfigError, as_arrays, field, pytree, with_values

NOT_NEGATIVE = {"range": (0.0, math.inf)}


@pytree
class Mixer:
    PINNED: ClassVar[dict[str, str]] = {"kept": "safety: it is kept", "tail*": "safety: it is a tail"}

    free: float = -0.3
    weight: float = 200.0
    divisor: float = field(default=0.05, metadata=POSITIVE)
    share: float = field(default=0.75, metadata=SHARE)
    inside: float = field(default=1e-3, metadata=INSIDE)
    window: float = field(default=3.0, metadata={"range": (2.0, 1e3)})
    nothing: float = field(default=0.0, metadata=NOT_NEGATIVE)
    all: float = field(default=1.0, metadata=SHARE)
    grid: tuple[float, ...] = (-1.0, 0.0, 0.1)
    kept: float = 1.0
    tail: tuple[float, ...] = (1.0, 2.0)


PARAMS = Mixer()
SPACE = space(PARAMS, ["*"])
LOOP = LoopParams()
EXTREMES = (0.0, 1e-3, 1.0, 7.0, 50.0, 1e3, 1e6)


def stacked(params, keys=SPACE.keys):
    """The numbers of these keys, as an array."""
    leaves, _ = jax.tree_util.tree_flatten_with_path(params)
    values = {jax.tree_util.keystr(path).removeprefix("."): leaf for path, leaf in leaves}
    return jnp.stack([jnp.asarray(values[key]) for key in keys])


def moved(z, base=PARAMS):
    return stacked(SPACE.params(z, base))


@pytest.mark.parametrize("jit", [False, True])
@pytest.mark.parametrize("params", [LOOP, PARAMS], ids=["loop", "mixer"])
def test_zero_is_where_one_starts_to_the_bit(params, jit):
    tuned, base = space(params, ["*"]), as_arrays(params)
    make = jax.jit(tuned.params) if jit else tuned.params
    made = make(tuned.start(), base)
    assert jax.tree.structure(made) == jax.tree.structure(base)
    for before, after in zip(jax.tree.leaves(base), jax.tree.leaves(made), strict=True):
        assert before.dtype == after.dtype
        assert before.tobytes() == np.asarray(after).tobytes()
    assert len(tuned.keys) == sum(number.tunable for number in trainables(params)) > 8


def test_params_of_numbers_do_as_well_as_arrays():
    z = jnp.linspace(-1.0, 1.0, len(SPACE.keys))
    np.testing.assert_array_equal(moved(z), moved(z, as_arrays(PARAMS)))


def test_all_transforms_are_looked_at():
    assert {number.transform for number in SPACE.numbers} == {"identity", "log", "logit", "fold"}


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("z", EXTREMES)
def test_no_coordinate_leaves_the_bounds_or_the_numbers(z, sign):
    coordinates = jnp.full(len(SPACE.keys), sign * z)
    values, slope = jax.jvp(moved, (coordinates,), (jnp.ones_like(coordinates),))
    assert np.isfinite(values).all()
    assert np.isfinite(slope).all()
    for number, value in zip(SPACE.numbers, np.asarray(values), strict=True):
        assert np.float32(number.low) <= value <= np.float32(number.high), number.key
    with_values(PARAMS, SPACE.values(coordinates))  # which checks what the fields state


def test_known_answers():
    values = SPACE.values(jnp.ones(len(SPACE.keys)))
    assert values["weight"] == pytest.approx(200 * math.e)
    assert values["share"] == pytest.approx(3 * math.e / (1 + 3 * math.e))  # the odds times e
    assert values["free"] == pytest.approx(0.0, abs=1e-7)
    assert values["window"] == pytest.approx(2 + 998 * math.e / (997 + math.e))
    assert values["nothing"] == pytest.approx(1.0)
    assert values["all"] == pytest.approx(0.75)  # mirrored at 1, a quarter of the range away
    size = (1 + 0 + 0.1) / 3
    assert values["grid"] == pytest.approx([-1 + size, size, 0.1 + size])


def test_a_value_on_its_bound_can_leave_it_either_way():
    at = [SPACE.keys.index("nothing"), SPACE.keys.index("all")]
    slope = jax.jacfwd(moved)(SPACE.start())[at, at]
    np.testing.assert_allclose(slope, [1.0, 0.25])
    for z in (-0.1, 0.1, 9.3):
        values = moved(jnp.full(len(SPACE.keys), z))[np.array(at)]
        assert values[0] == pytest.approx(abs(z))
        assert 0 <= values[1] < 1
    assert moved(jnp.full(len(SPACE.keys), 8.0))[at[1]] == pytest.approx(1.0)  # there and back again


def test_gradients_are_those_of_differences(x64):
    base = as_arrays(PARAMS, jnp.float64)
    for shift in (-2.3, 0.0, 1.7):
        z = jnp.asarray(np.linspace(-0.5, 0.5, len(SPACE.keys)) + shift)
        z = jnp.where(jnp.abs(z) < 1e-2, 0.1, z)  # off the kink of a fold
        found = jax.jacrev(lambda z: moved(z, base))(z)
        step = 1e-6
        difference = (moved(z + step, base) - moved(z - step, base)) / (2 * step)
        np.testing.assert_allclose(jnp.diagonal(found), difference, rtol=1e-6)
        np.testing.assert_array_equal(found - jnp.diag(jnp.diagonal(found)), 0)


def test_a_unit_of_any_coordinate_changes_a_value_by_its_scale():
    slope = jnp.diagonal(jax.jacfwd(moved)(SPACE.start()))
    np.testing.assert_allclose(slope, [number.scale for number in SPACE.numbers], rtol=1e-5)


def test_it_is_vmapped_over_coordinates_and_static_in_jit():
    batch = jnp.stack([jnp.full(len(SPACE.keys), z) for z in (-1.0, 0.0, 2.0)])
    np.testing.assert_allclose(jax.vmap(moved)(batch), jnp.stack([moved(z) for z in batch]), rtol=1e-6)
    traced = []

    def weight(space, z):
        traced.append(space)
        return space.params(z, PARAMS).weight

    make = jax.jit(weight, static_argnums=0)
    assert make(SPACE, batch[1]) == 200
    assert make(space(PARAMS, "*"), batch[1]) == 200
    assert traced == [SPACE]


def test_values_go_through_a_parameter_file(tmp_path):
    tuned = space(LOOP, ["stack.planning.primitives.offsets[1]", "stack.planning.*.weights.*", "stack.behavior.gvp"])
    unmoved = tuned.values(tuned.start())
    assert unmoved["stack.planning.primitives.offsets"] == list(LOOP.stack.planning.primitives.offsets)
    assert unmoved["stack.planning.micro.weights.transition"] == 0.05  # and not 0.05000000074505806
    z = jax.random.normal(jax.random.key(0), (len(tuned.keys),))
    write_parameters(tmp_path / "tuned.yaml", tuned.values(z), about={"made": "by a test"})
    read = as_arrays(with_values(LOOP, read_parameters(tmp_path / "tuned.yaml")))
    made = tuned.params(z, as_arrays(LOOP))
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=2e-7), read, made)
    others = [number.key for number in trainables(LOOP) if number.key not in tuned.keys]
    np.testing.assert_array_equal(stacked(made, others), stacked(as_arrays(LOOP), others))


def test_patterns_take_what_may_be_tuned_of_what_they_mean():
    assert "kept" not in SPACE.keys
    assert not [key for key in SPACE.keys if key.startswith("tail")]
    assert space(PARAMS, ["grid"]).keys == space(PARAMS, "grid[*]").keys == ("grid[0]", "grid[1]", "grid[2]")
    assert space(PARAMS, ["share", "grid[2]", "sh*"]).keys == ("share", "grid[2]")
    tuned = space(LOOP, ["stack.planning.micro.weights.*", "stack.behavior.gvp.tau"])
    assert len(tuned.keys) == 9
    assert "stack.planning.micro.weights.length" not in tuned.keys


PINNED = [number for number in trainables(LOOP) if not number.tunable]


def test_no_pattern_reaches_what_is_fixed():
    fixed = {number.key for number in PINNED}
    for pattern in ("*", "stack", "stack.*.m*", "*[?]"):
        assert fixed.isdisjoint(space(LOOP, [pattern]).keys)
    for number in {number.pinned: number for number in PINNED}.values():
        with pytest.raises(ConfigError) as refused:
            space(LOOP, [number.key])
        assert str(refused.value) == f"'{number.key}' is fixed: {number.pinned}"


REFUSED = {
    "unknown": (["stack.behavior.gvp.taus"], r"'stack\.behavior\.gvp\.taus' is no continuous number; .* '.*gvp\.tau'"),
    "static": (["stack.planning.macro.n_layers"], "'stack.planning.macro.n_layers' is no continuous number; the near"),
    "element": (["stack.planning.primitives.offsets[7]"], r"offsets\[7\]' is no continuous number; .*offsets"),
    "fixed": (["*.tau", "vehicle.width"], "'vehicle.width' is fixed: fact: of the vehicle"),
    "fixed group": (["sim"], r"'sim' means fixed numbers only, as 'sim\.traffic\.idm\.acceleration': fact: of the"),
    "nothing": ([], "nothing is to be tuned: give at least one dotted key"),
}


@pytest.mark.parametrize(("patterns", "message"), REFUSED.values(), ids=REFUSED)
def test_patterns_that_mean_nothing_to_tune_are_refused(patterns, message):
    with pytest.raises(ConfigError, match=message):
        space(LOOP, patterns)


def test_coordinates_of_another_space_and_other_params_are_refused():
    with pytest.raises(ConfigError, match=r"z is of float32 and shape \(3,\): give a float for each of the 11 numbers"):
        SPACE.params(jnp.zeros(3), PARAMS)
    with pytest.raises(ConfigError, match="z is of int32"):
        SPACE.values(jnp.zeros(11, int))
    with pytest.raises(ConfigError, match="base is a LoopParams without 'free': give what the space was made of"):
        SPACE.params(SPACE.start(), LOOP)


def test_a_space_is_a_value_and_no_pytree():
    assert isinstance(SPACE, Space)
    assert hash(SPACE) == hash(space(Mixer(), ["*"]))
    assert jax.tree.leaves(SPACE) == [SPACE]  # no pytree


def with_network():
    """A loop whose planner has a learned cost that adds nothing yet."""
    loop = as_arrays(LOOP)
    planning = loop.stack.planning
    learned = initial(jax.random.key(0), jnp.ones(len(MICRO_TERMS)), hidden=4)
    planning = planning.replace(micro=planning.micro.replace(learned=learned))
    return loop.replace(stack=loop.stack.replace(planning=planning))


def test_layers_of_a_learned_cost_are_moved_beside_the_numbers():
    base, key = with_network(), "stack.behavior.gvp.tau"
    both, alone = space(base, [key], network=True), space(base, [], network=True)
    layers = (base.stack.planning.micro.learned.kernel, base.stack.planning.micro.learned.bias)
    count = sum(leaf.size for leaf in jax.tree.leaves(layers))
    assert (both.size, alone.size) == (1 + count, count)
    assert len(both.keys) == both.size
    assert both.keys[1] == "stack.planning.micro.learned.kernel[0][0, 0]"
    for before, after in zip(*map(jax.tree.leaves, (base, both.params(both.start(), base))), strict=True):
        np.testing.assert_array_equal(before, after)
    z = jnp.arange(float(count))
    made = alone.params(z, base).stack.planning.micro.learned
    moved = [x - y for x, y in zip(jax.tree.leaves((made.kernel, made.bias)), jax.tree.leaves(layers), strict=True)]
    np.testing.assert_allclose(jnp.concatenate([x.ravel() for x in moved]), ELEMENT * z, atol=1e-4)
    np.testing.assert_array_equal(made.size, base.stack.planning.micro.learned.size)
    assert alone.values(z) == {}
    assert list(both.values(both.start())) == [key]


def test_without_a_learned_cost_there_is_none_to_tune():
    with pytest.raises(ConfigError, match="no learned cost"):
        space(LOOP, ["*"], network=True)
