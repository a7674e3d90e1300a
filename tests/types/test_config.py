"""Config and params classes say the same, and what a user gets wrong is named in one line."""

import dataclasses
import enum
import importlib
import inspect
import pkgutil

import pytest

import urbanjax
from urbanjax.types import ConfigError, config, pytree, static


class Mode(enum.Enum):
    SLOW = 1
    FAST = 2


@pytree
class Inner:
    gain: float = 0.5
    shift: float = 0.0
    share: float = static(default=0.5, metadata={"range": (0.0, 1.0)})
    steps: int = static(default=3)


@pytree
class Outer:
    inner: Inner = Inner()
    other: Inner = Inner(gain=2.0)
    grid: tuple[float, ...] = (-1.0, 0.0, 1.0)
    clamp: float | None = None
    mode: Mode = static(default=Mode.SLOW)
    kind: str = static(default="one", metadata={"choices": ("one", "two")})
    kinds: tuple[str, ...] = static(default=("one",), metadata={"choices": ("one", "two")})
    start: int = static(default=0)
    fast: bool = static(default=False)


@pytree
class Sparse:
    one: Inner | None = None
    other: Inner | None = Inner(gain=3.0)
    several: tuple[Inner, ...] = (Inner(gain=1.0), Inner(gain=2.0))


@pytree
class Whole:
    sparse: Sparse = Sparse(one=Inner(gain=7.0), other=None)


def params_classes():
    found = {}
    for module in pkgutil.walk_packages(urbanjax.__path__, "urbanjax."):
        for name, cls in inspect.getmembers(importlib.import_module(module.name), inspect.isclass):
            if cls.__module__ == module.name and dataclasses.is_dataclass(cls) and name.endswith(("Params", "Study")):
                found[f"{module.name}.{name}"] = cls
    return found


@pytest.mark.parametrize("cls", params_classes().values(), ids=params_classes())
def test_round_trip_of_every_params_class(cls):
    tree = config.schema(cls)
    assert config.to_params(cls, tree) == cls()
    assert config.plain(cls()) == tree


@pytest.mark.parametrize("cls", params_classes().values(), ids=params_classes())
def test_a_text_states_what_it_may_be(cls):
    for spec in dataclasses.fields(cls):
        if isinstance(config.default_of(spec), str) and not spec.metadata.get("path"):
            assert config.default_of(spec) in spec.metadata["choices"], spec.name


def test_values_reach_their_fields_and_the_rest_keeps_the_parents_defaults():
    params = config.to_params(Outer, {"other": {"shift": -1}, "mode": "fast", "clamp": 2, "grid": [0, 3]})
    assert params == Outer(other=Inner(gain=2.0, shift=-1.0), mode=Mode.FAST, clamp=2.0, grid=(0.0, 3.0))
    assert isinstance(params.clamp, float)


@pytest.mark.parametrize("make", [config.to_params, lambda cls, tree: config.updated(cls(), tree)])
def test_a_group_that_may_be_none_or_is_one_of_several_keeps_the_parents_values(make):
    shift, base = {"shift": 1.0}, Whole().sparse
    made = make(Whole, {"sparse": {"one": shift}})
    assert made == Whole(base.replace(one=Inner(gain=7.0, shift=1.0)))
    assert make(Whole, {"sparse": {"other": shift}}) == Whole(base.replace(other=Inner(gain=3.0, shift=1.0)))
    assert make(Whole, {"sparse": {"one": None}}) == Whole(base.replace(one=None))
    several = make(Whole, {"sparse": {"several": [shift, {}, shift]}}).sparse.several
    assert several == (Inner(gain=1.0, shift=1.0), Inner(gain=2.0), Inner(gain=2.0, shift=1.0))


@pytest.mark.parametrize("group", [{"one": {"gian": 1}}, {"other": {"gian": 1}}, {"several": [{"gian": 1}]}])
def test_a_mistake_in_such_a_group_is_named(group):
    with pytest.raises(ConfigError, match=r"unknown key 'sparse.*gian'; the nearest valid key is 'sparse.*gain'"):
        config.to_params(Whole, {"sparse": group})


BAD = {
    "unknown key": (
        {"iner": {"gain": 1}},
        "unknown key 'stack.iner' in here.yaml; the nearest valid key is 'stack.inner'",
    ),
    "unknown nested key": ({"inner": {"gian": 1}}, "'stack.inner.gian' .*nearest valid key is 'stack.inner.gain'"),
    "code": ({"inner": {"_target_": "os.system"}}, "'stack.inner._target_' .*refused"),
    "text for a number": ({"inner": {"gain": "fast"}}, "'stack.inner.gain' must be a finite number, not 'fast'"),
    "true for a number": ({"inner": {"gain": True}}, "finite number"),
    "not a number": ({"inner": {"gain": float("nan")}}, "finite number, not nan"),
    "infinite": ({"grid": [0.0, float("inf")]}, r"'stack.grid\[1\]' must be a finite number"),
    "negative size": ({"inner": {"steps": -3}}, "'stack.inner.steps' must be at least 1, not -3"),
    "zero size": ({"inner": {"steps": 0}}, "at least 1"),
    "negative count": ({"start": -1}, "at least 0"),
    "negative magnitude": ({"inner": {"gain": -0.1}}, "at least 0, not -0.1"),
    "out of range": ({"inner": {"share": 1.5}}, "between 0 and 1, not 1.5"),
    "more than can be counted": ({"start": 10**23}, "'stack.start' must be at most 9007199254740992"),
    "half a size": ({"inner": {"steps": 1.5}}, "whole number"),
    "empty grid": ({"grid": []}, "'stack.grid' must not be empty"),
    "number for a grid": ({"grid": 1.0}, "must be a list"),
    "number for a group": ({"inner": 1.0}, "group of values"),
    "no such member": ({"mode": "quick"}, "one of slow, fast, not 'quick'"),
    "no such choice": ({"kind": "three"}, "one of one, two, not 'three'"),
    "no such choice in a grid": ({"kinds": ["one", "three"]}, r"'stack.kinds\[1\]' must be one of one, two"),
    "text for an optional number": ({"clamp": "fast"}, "'stack.clamp' must be a finite number, not 'fast'"),
    "number for a switch": ({"fast": 1}, "true or false"),
}


@pytest.mark.parametrize(("values", "message"), BAD.values(), ids=BAD)
def test_a_mistake_is_named_in_one_line(values, message):
    with pytest.raises(ConfigError, match=message) as caught:
        config.to_params(Outer, values, prefix="stack.", source="here.yaml")
    assert "\n" not in str(caught.value)


def test_a_class_without_a_default_is_refused():
    @pytree
    class Open:
        gain: float

    with pytest.raises(ConfigError, match="'gain' has no default"):
        config.schema(Open)
