"""Every continuous number of params is known once: whether it may be tuned, within which bounds, in which unit."""

import dataclasses
import fnmatch
import math
from typing import ClassVar

import jax
import jax.numpy as jnp
import pytest

from urbanjax.numerics.soft import Relaxation
from urbanjax.rollout import LoopParams
from urbanjax.stack import StackParams
from urbanjax.tuning import trainables
from urbanjax.tuning.trainable import unit_of
from urbanjax.types import POSITIVE, SHARE, ConfigError, Unread, as_arrays, field, pytree, static
from urbanjax.types.limits import TINY
from urbanjax.types.pinned import KINDS, fits, pinned


@pytree
class Knob:
    PINNED: ClassVar[dict[str, str]] = {"stop": "safety: it stops", "length": "scale: its unit"}
    UNREAD: ClassVar[dict[str, Unread | None]] = {"idle": Unread("nobody does", lambda p: p.n == 3)}

    gain: float = 2.0  # m/s^2, upwards
    stop: float = 1.0  # per m of way, and more
    length: float = 1.0
    idle: float = 1.0
    share: float = field(default=0.25, metadata=SHARE)
    free: float = 0.0  # rad
    n: int = static(default=3)


@pytree
class Panel:
    PINNED: ClassVar[dict[str, str]] = {"knob.length": ""}

    knob: Knob = Knob(gain=3.0)
    several: tuple[Knob, ...] = (Knob(), Knob(n=4))
    grid: tuple[float, ...] = (-1.0, 0.0, 2.0)  # m
    times: tuple[float, ...] = field(default=(2.0,), metadata=POSITIVE)


LOOP = trainables(LoopParams())
BY_KEY = {number.key: number for number in LOOP}


def classes(params):
    """The classes within params."""
    yield type(params)
    for spec in dataclasses.fields(params):
        if dataclasses.is_dataclass(getattr(params, spec.name)):
            yield from classes(getattr(params, spec.name))


@pytest.mark.parametrize("params", [LoopParams(), as_arrays(LoopParams()), Panel()], ids=["loop", "arrays", "panel"])
def test_every_float_leaf_is_known_once_and_in_its_order(params):
    leaves, _ = jax.tree_util.tree_flatten_with_path(params)
    numbers = trainables(params)
    assert [number.key for number in numbers] == [jax.tree_util.keystr(path).removeprefix(".") for path, _ in leaves]
    assert [number.value for number in numbers] == pytest.approx([float(leaf) for _, leaf in leaves])
    assert len({number.key for number in numbers}) == len(numbers) > 10


def test_arrays_are_the_numbers_that_were_written_down():
    assert trainables(as_arrays(LoopParams())) == LOOP


def test_a_class_says_which_are_fixed_and_why():
    fixed = {number.key: number.pinned for number in trainables(Panel()) if not number.tunable}
    assert fixed.pop("knob.stop") == "safety: it stops"
    assert fixed.pop("knob.idle") == "nothing reads it: nobody does"
    assert fixed.pop("several[0].stop") == fixed.pop("several[1].stop") == "safety: it stops"
    assert fixed.pop("several[0].length") == fixed.pop("several[1].length") == "scale: its unit"
    assert fixed == {}  # what 'knob.length' says is taken back, and the others are free


def test_a_reason_is_of_a_kind():
    wrong = type("Wrong", (Knob,), {"PINNED": {"gain": "because"}})
    with pytest.raises(ConfigError, match=r"Wrong\.PINNED\['gain'\] must begin with one of safety, "):
        pinned(wrong())


def test_every_pattern_of_the_stack_means_some_number():
    keys = {number.key for number in LOOP}
    for pattern in pinned(LoopParams()):
        assert any(fits(key, pattern) for key in keys), pattern
    stated = [why for cls in classes(LoopParams()) for why in vars(cls).get("PINNED", {}).values()]
    assert {why.partition(": ")[0] for why in stated} == set(KINDS)
    assert all(len(why.partition(": ")[2]) > 5 for why in stated)


FIXED = {
    "safety": [
        "*.weights.collision",
        "*.weights.forbidden",
        "*.weights.line",
        "*.infeasible",
        "*.kept",
        "stack.*.margin",
        "stack.behavior.headway.time_headway",
    ],
    "scale": ["stack.planning.micro.weights.length"],
    "fact": ["vehicle.*", "period", "sensor.*", "sim.*", "stack.lidar.*"],
    "soft": ["stack.planning.*_scale", "stack.behavior.*_scale", "stack.relaxation.temperature"],
}


@pytest.mark.parametrize("mode", ["hard", "soft"])
@pytest.mark.parametrize("kind", FIXED)
def test_what_guards_is_true_or_only_soft_stays_as_it_is(kind, mode):
    numbers = trainables(LoopParams(stack=StackParams(relaxation=Relaxation(mode=mode))))
    for pattern in FIXED[kind]:
        meant = [number for number in numbers if fnmatch.fnmatchcase(number.key, pattern)]
        kinds = {number.pinned.partition(":")[0] for number in meant if not number.key.startswith("stack.search")}
        assert kinds == {kind}, pattern


def test_taste_may_be_tuned():
    keys = [
        "stack.planning.micro.weights.obstacle",
        "stack.planning.macro.weights.lane_change",
        "stack.planning.macro.horizon",
        "stack.planning.primitives.offsets[3]",
        "stack.behavior.gvp.tau",
        "stack.behavior.headway.deceleration",
        "stack.behavior.caps.lateral_acceleration",
        "stack.control.lateral.gain",
    ]
    assert [key for key in keys if not BY_KEY[key].tunable] == []
    groups = {number.group for number in LOOP if number.tunable}
    assert not [group for group in groups if not group.startswith("stack.")]


def test_bounds_are_those_of_a_config():
    known = {number.key: number for number in trainables(Panel())}
    bounds = {key: (number.low, number.high, number.transform) for key, number in known.items()}
    assert bounds["knob.gain"] == (0.0, math.inf, "log")
    assert bounds["knob.share"] == (0.0, 1.0, "logit")
    assert bounds["knob.free"] == bounds["grid[0]"] == (-math.inf, math.inf, "identity")
    assert bounds["times[0]"] == (TINY, math.inf, "log")
    assert known["knob.gain"].scale == 3.0
    assert known["knob.share"].scale == 0.25 * 0.75
    assert (known["knob.free"].scale, known["grid[1]"].scale) == (1.0, 1.0)
    assert {number.transform for number in trainables(Panel(knob=Knob(gain=0.0, share=1.0)))[:5:4]} == {"fold"}


def test_keys_have_a_group_and_the_name_of_their_field():
    number = BY_KEY["stack.planning.primitives.offsets[3]"]
    assert (number.field, number.group) == ("stack.planning.primitives.offsets", "stack.planning.primitives")
    assert (BY_KEY["period"].field, BY_KEY["period"].group) == ("period", "")


def test_units_are_read_from_the_comments():
    assert BY_KEY["stack.planning.micro.weights.curvature"].unit == "per rad of turn"
    assert BY_KEY["stack.behavior.caps.curve_deceleration"].unit == "m/s^2"
    assert BY_KEY["stack.behavior.gvp.tau"].unit == "[-]"  # above its field
    known = {number.key: number.unit for number in trainables(Panel())}
    assert known["knob.gain"] == "m/s^2"
    assert known["knob.stop"] == "per m of way"
    assert known["knob.length"] == ""
    assert known["grid[2]"] == "m"


@pytest.mark.parametrize(
    ("comment", "unit"),
    {
        "m": "m",
        "m beside the macro plan": "m",
        "1/m, or what the steering allows": "1/m",
        "m per squared rad, tells apart": "m per squared rad",
        "m per m/s": "m per m/s",
        "s^2, variance over": "s^2",
        "mean squared distance": "",
        "slope that is too steep": "",
        "share of the returns": "",
        "": "",
    }.items(),
)
def test_a_unit_is_what_a_comment_begins_with(comment, unit):
    assert unit_of(comment) == unit


def test_a_size_of_the_stack_has_a_unit_or_is_a_share():
    """Of what may be tuned: what has no unit says of what it is a share."""
    assert {number.field for number in LOOP if number.tunable and not number.unit} == {
        "stack.planning.primitives.speed_factors"
    }


@pytest.mark.parametrize(
    ("params", "message"),
    [
        (LoopParams, "params is .*: give an instance"),
        (3.0, "params is 3.0: give an instance"),
        (LoopParams(period=jnp.ones(2)), r"'period' is an array of shape \(2,\): give params of numbers"),
    ],
    ids=["class", "number", "batch"],
)
def test_what_are_no_params_is_refused(params, message):
    with pytest.raises(ConfigError, match=message):
        trainables(params)


def test_inside_jit_there_are_no_numbers():
    with pytest.raises(ConfigError, match="params are traced"):
        jax.jit(lambda knob: trainables(knob)[0].value)(Knob())
