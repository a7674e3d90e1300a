"""One call asks how good a driver is; wrong names and what is no driver are told in one line."""

import pytest

from urbanjax import evaluation
from urbanjax.drivers import IdmDriver
from urbanjax.rollout import LoopParams
from urbanjax.types import ConfigError


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"driver": 3}, "needs init"),
        ({"missions": ["overtak"]}, "'overtak' is none of overtake, cut_in"),
        ({"missions": None}, "give names"),
        ({"missions": []}, "give names"),
        ({"missions": [3]}, "3 is none of"),
        ({"traffic": "nice"}, "'nice' is none of idm, mixed"),
        ({"seeds": 0}, "seeds is 0"),
        ({"seeds": 1.5}, "seeds is 1.5"),
        ({"params": 3}, "params is a int"),
        ({"params": [LoopParams(), None]}, "params is a NoneType"),
        ({"params": []}, "no parameter set"),
        ({"params": [LoopParams(), LoopParams(driver=IdmDriver())]}, "set 1 differs from set 0 in 'driver'"),
    ],
)
def test_a_mistake_is_one_line(asked, message):
    with pytest.raises(ConfigError, match=message) as found:
        evaluation.qualify.__wrapped__(**asked)
    assert "\n" not in str(found.value)
