"""A class says which values nothing reads, and whoever sets one is told."""

from typing import ClassVar

import pytest

from urbanjax.types import ConfigError, Unread, pytree, static
from urbanjax.types.unread import changed, check_read


@pytree
class Part:
    UNREAD: ClassVar[dict[str, Unread | None]] = {"a_*": Unread("only a soft one does", lambda p: p.mode == "hard")}

    a_scale: float = 1.0
    gain: float = 1.0
    mode: str = static(default="hard")


@pytree
class Base:
    UNREAD: ClassVar[dict[str, Unread | None]] = {"two": Unread("one is enough, see 'one'")}

    one: Part = Part()
    two: Part = Part()


@pytree
class Wider(Base):
    UNREAD: ClassVar[dict[str, Unread | None]] = {"one.gain": Unread("every one of 'gains' is"), "one.a_*": None}

    gains: tuple[float, ...] = (1.0,)


REFUSED = {
    "of a part": (Base(), "one.a_scale", "'one.a_scale' is read by nothing here: only a soft one does"),
    "a group": (Base(), "two", "'two' is read by nothing here: one is enough, see 'one'"),
    "within a group": (Base(), "two.gain", "'two.gain' .* one is enough"),
    "inherited": (Wider(), "two.mode", "'two.mode' .* one is enough"),
    "added": (Wider(), "one.gain", "'one.gain' .* every one of 'gains' is"),
}


@pytest.mark.parametrize(("params", "key", "message"), REFUSED.values(), ids=REFUSED)
def test_a_key_that_nothing_reads_is_named(params, key, message):
    with pytest.raises(ConfigError, match=message):
        check_read(params, ["one.mode", key])


def test_everything_else_passes():
    check_read(Base(), ["one", "one.gain", "one.mode"])
    check_read(Base(one=Part(mode="soft")), ["one.a_scale"])
    check_read(Wider(), ["one.a_scale", "gains", "seed"])  # what the part says is taken back


def test_what_differs_is_what_was_changed():
    defaults = {"a": {"b": 1.0, "c": [1, 2]}, "d": None}
    assert list(changed({"a": {"b": 1, "c": [1, 2]}, "d": None}, defaults)) == []
    assert list(changed({"a": {"b": 2.0, "c": [1]}, "d": "x"}, defaults)) == ["a.b", "a.c", "d"]
