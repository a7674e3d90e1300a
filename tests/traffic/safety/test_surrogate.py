"""Safety measures of plain arrays: the same as of records, near any origin, and refused where they are none."""

import jax
import numpy as np
import pytest

from urbanjax import traffic
from urbanjax.types.errors import TrafficError

STEPS = 12
TIME = 0.1 * np.arange(STEPS)


def chase(at=0.0):
    """Two vehicles in one lane: at 15 m/s, 30 m behind one of 10 m/s."""
    x = np.stack([15 * TIME, 30 + 10 * TIME], 1)
    place = np.stack([x, np.zeros_like(x)], -1) + at
    return {"position": place, "heading": np.zeros((STEPS, 2)), "speed": np.full((STEPS, 2), [15.0, 10.0]), "dt": 0.1}


def test_known_answers_anywhere():
    """The gap closes at 5 m/s from 30 m less a length of 4.5 m."""
    here, far = (jax.device_get(traffic.surrogate_safety(**chase(at))) for at in (0.0, 4.2e6))
    least = (30 - 4.5 - 5 * TIME[-1]) / 5
    np.testing.assert_allclose(here.summary.min_ttc, [least, np.inf], rtol=1e-4)
    np.testing.assert_allclose(here.summary.max_deceleration[0], 25 / (2 * (25.5 - 5 * TIME[-1])), rtol=1e-4)
    np.testing.assert_allclose(far.summary.min_ttc, here.summary.min_ttc, rtol=1e-3)
    np.testing.assert_allclose(far.summary.min_headway[0], here.summary.min_headway[0], rtol=1e-3)


def test_sizes_and_absence():
    rows = chase()
    rows["speed"][:3, 1] = np.nan  # not yet there
    found = jax.device_get(traffic.surrogate_safety(**rows, size=([4.5, 12.0], 2.0)))
    assert np.isinf(found.series.following.ttc[:3, 0]).all()
    np.testing.assert_allclose(found.series.following.gap[3:, 0], 30 - 8.25 - 5 * TIME[3:], rtol=1e-4)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"heading": np.zeros(STEPS)}, r"heading has the shape \(12,\), and position \(12, 2, 2\)"),
        ({"position": np.zeros((STEPS, 2))}, r"position has the shape \(12, 2\): give \[T, V, 2\]"),
        ({"position": np.full((STEPS, 2, 2), np.nan)}, "no vehicle is there"),
        ({"position": "log"}, "position: str is no array"),
        ({"params": 3}, "params is a int"),
        ({"size": 4.5}, "size is 4.5: give two"),
        ({"valid": np.ones((STEPS, 2))}, "of float64: truth values"),
        ({"speed": np.zeros((2, STEPS))}, r"speed has the shape \(2, 12\)"),
        ({"dt": 1e9}, "dt is 1e[+]09 s: samples of one scene"),
        ({"dt": 100.0}, "dt is 100 s: samples"),
        ({"speed": 3.6 * chase()["speed"]}, "speed of vehicle 0 is 3.6 times that of its positions.* looks like km/h"),
        (
            {"dt": 1.0},
            "speed of vehicle 0 is 10 times that of its positions.*position is in m, speed in m/s and dt in s",
        ),
        ({"position": chase()["position"][..., ::-1], "heading": np.full((STEPS, 2), 90.0)}, "looks like degrees"),
        ({"position": 0 * chase()["position"], "heading": np.full((STEPS, 2), 90.0)}, "is 90 rad, which looks like"),
        ({"size": (1.8, 4.5)}, "each width is greater than the length; give the length first"),
        ({"dt": 0.0}, "dt is 0.0: it must be a positive number"),
        ({"size": (0.0, 1.8)}, "length must be positive"),
        ({"size": (4.5, [1.8] * 3)}, r"width has the shape \(3,\)"),
        ({"valid": np.ones((2, STEPS), bool)}, "valid has the shape"),
        (
            {"valid": np.ones((STEPS, 2), bool), "speed": np.full((STEPS, 2), np.nan)},
            "vehicle 0 at time 0 is valid and",
        ),
    ],
)
def test_what_is_no_traffic_is_refused(change, message):
    with pytest.raises(TrafficError, match=message) as caught:
        traffic.surrogate_safety.__wrapped__(**(chase() | change))
    assert "\n" not in str(caught.value)
