"""`help()` of a record shows shapes, units and defaults of its fields."""

import inspect

import pytest

import urbanjax
from urbanjax.registration import AlignParams, CovarianceParams, Registration
from urbanjax.types import Objects, pytree


def test_fields_with_their_comments():
    text = inspect.getdoc(Objects)
    assert text.startswith("Perceived objects, padded to O")
    assert "position (Array): [O, 2] m\n" in text
    assert "speed (Array): [O] m/s, along the heading\n" in text


def test_defaults_and_comments_above():
    assert "damping (float = 0.001): at the start, added to the diagonal" in inspect.getdoc(AlignParams)
    assert "scale (float = 4.0): s^2, variance over that of independent pairs" in inspect.getdoc(CovarianceParams)
    assert "neighbours (int = 1): voxels that a point may belong to" in inspect.getdoc(AlignParams)


def test_what_are_no_fields_is_not_shown():
    text = inspect.getdoc(urbanjax.LoopParams)
    assert "UNREAD" not in text
    assert "period (float = 0.1): s, of one step of the driver" in text
    assert "status" not in inspect.getdoc(Registration)


def test_a_record_without_source_keeps_its_docstring():
    space = {"pytree": pytree}
    exec('@pytree\nclass Bare:\n    """A record."""\n    x: float = 0.0  # m\n', space)
    assert space["Bare"].__doc__ == "A record."
    assert space["Bare"](1.0).replace(x=2.0).x == 2.0


@pytest.mark.parametrize("record", [urbanjax.LoopParams, Registration])
def test_help_is_printed(record, capsys):
    help(record)
    assert "Fields:" in capsys.readouterr().out
