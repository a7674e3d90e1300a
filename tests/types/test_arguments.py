"""What a caller got wrong is told in one line, of the class that the place raises."""

import numpy as np
import pytest

from urbanjax import with_values
from urbanjax.io import clouds, logs, maps
from urbanjax.rollout import LoopParams, rollout
from urbanjax.stack import StackParams
from urbanjax.types import ConfigError, FileError, ScenarioError
from urbanjax.types.arguments import array, kind, number, whole
from urbanjax.vehicle.params import VehicleParams


@pytest.mark.parametrize("value", [0, -1.0, float("nan"), float("inf"), "1", None, True, [1.0], 1j])
def test_no_positive_number(value):
    with pytest.raises(ConfigError, match=r"size is .*: it must be a positive number"):
        number(value, "size", error=ConfigError)


def test_numbers():
    assert number(np.float32(0.5), "size", error=ConfigError) == 0.5
    assert number(-2, "size", error=ConfigError, positive=False) == -2.0
    assert whole(np.int64(3), "n", error=ConfigError, least=1) == 3
    for value in (0, 2.5, "3", True, None):
        with pytest.raises(ScenarioError, match=r"n is .*: it must be a whole number, at least 1"):
            whole(value, "n", error=ScenarioError, least=1)
    assert whole(np.array(3), "n", error=ConfigError, least=1, most=3) == 3
    with pytest.raises(ScenarioError, match="n is 4: it must be a whole number, between 1 and 3"):
        whole(4, "n", error=ScenarioError, least=1, most=3)


def test_arrays_and_kinds():
    assert array([[1, 2]], "p", error=ConfigError).dtype == float
    for value in ("text", [1j], [[1], [1, 2]], None, {}, [True]):
        with pytest.raises(ConfigError, match=r"p: .* is no array of real numbers"):
            array(value, "p", error=ConfigError)
    with pytest.raises(ConfigError, match="p: some of it is masked"):
        array(np.ma.masked_array([1.0, 2.0], [False, True]), "p", error=ConfigError)
    assert array(np.ma.masked_array([1.0, 2.0]), "p", error=ConfigError).tolist() == [1.0, 2.0]
    stack = StackParams(vehicle=VehicleParams())
    with pytest.raises(ScenarioError, match=r"params is a StackParams: give a VehicleParams, here its \.vehicle"):
        kind(stack, "params", wanted=VehicleParams, error=ScenarioError)
    with pytest.raises(ScenarioError, match="start is a int: give a str or float"):
        kind(3, "start", wanted=(str, float), error=ScenarioError)


@pytest.mark.parametrize("reader", [maps.read, clouds.read, logs.read])
@pytest.mark.parametrize("path", [None, 3, b"x"])
def test_what_is_no_path(reader, path):
    with pytest.raises(FileError, match="is no path of a file"):
        getattr(reader, "__wrapped__", reader)(path)


@pytest.mark.parametrize("reader", [maps.read, clouds.read, logs.read])
@pytest.mark.parametrize(
    ("path", "message"),
    [("", "is no name of a file: it is empty"), ("a\0b.ply", "zero byte"), ("x" * 400 + ".csv", "404 characters")],
)
def test_what_no_file_is_called(reader, path, message):
    with pytest.raises(FileError, match=message):
        reader(path)


@pytest.mark.parametrize("reader", [maps.read, clouds.read, logs.read])
def test_a_folder_is_no_file(reader, tmp_path):
    with pytest.raises(FileError, match="is a folder"):
        reader(tmp_path)


def test_what_is_no_params_or_no_values():
    bare = with_values.__wrapped__
    with pytest.raises(ConfigError, match="params is a int"):
        bare(3, {})
    for values in (["a"], {3: 1.0}, None):
        with pytest.raises(ConfigError, match="values must map dotted keys"):
            bare(LoopParams(), values)


def test_what_is_no_course():
    with pytest.raises(ScenarioError, match="course is a NoneType: give a Course"):
        rollout.__wrapped__(LoopParams(), None, None, None, 3)
