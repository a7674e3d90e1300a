"""Two arrays in, a divergence with its interval out; what is no log is refused in one line."""

import numpy as np
import pytest

from urbanjax import traffic
from urbanjax.traffic import ResamplingParams
from urbanjax.types.errors import TrafficError

SHORT = ResamplingParams(draws=20, blocks=10)


def normal(n, shift=0.0, seed=0):
    return np.random.default_rng(seed).normal(size=(n, 2)) + np.array([shift, 0.0])


def test_known_answer_for_arrays_of_different_lengths():
    """D(N(0, 1) || N(1, 1)) = 1/2."""
    found = traffic.kl_divergence(normal(600), normal(400, 1.0, seed=1), resampling=SHORT)
    assert found.samples == (600, 400)
    assert found.low < 0.5 < found.high
    assert abs(found.value - 0.5) < 4 * found.deviation
    assert found.low < found.value < found.high


def test_far_from_the_origin_and_in_another_unit_of_place_it_is_the_same():
    p, q = normal(600), normal(400, 1.0, seed=1)
    here, far = (traffic.kl_divergence(p + at, q + at, resampling=SHORT) for at in (0.0, 4.2e6))
    assert far.value == pytest.approx(here.value, abs=1e-4)


def test_repeated_samples_may_be_left_out_and_are_counted():
    p = np.repeat(normal(100), 6, axis=0)
    with pytest.raises(TrafficError, match=r"600 samples of p coincide.*set ties to dedupe"):
        traffic.kl_divergence(p, normal(400, seed=1), resampling=SHORT)
    found = traffic.kl_divergence(p, normal(400, seed=1), ties="dedupe", resampling=SHORT)
    assert (found.samples, found.dropped) == ((100, 400), (500, 0))


@pytest.mark.parametrize(
    ("p", "given", "message"),
    [
        (normal(10), {}, "p has 10 samples: k=5"),
        (normal(100).T[None], {}, r"p has the shape \(1, 2, 100\)"),
        (np.full((100, 2), np.nan), {}, "p: 100 samples are not finite"),
        (np.zeros((100, 3)), {}, "p has 3 columns and q 2"),
        ("log.csv", {}, "p: str is no array of real numbers"),
        (normal(100), {"k": 0}, "k is 0: it must be a whole number, at least 1"),
        (normal(100, seed=9), {}, "p and q hold the same samples"),
        (normal(100, 1.0), {"k": 2.5}, "k is 2.5: it must be a whole number"),
        (np.zeros((0, 2)), {}, "p has no samples"),
        (normal(100) > 0, {}, "p: ndarray is no array of real numbers"),
        (normal(100) * 1e30, {}, r"p holds a coordinate of .*e\+30 m, beyond 1e\+09"),
        (normal(100) * 1e200, {}, "p holds a coordinate of"),
        (np.ma.masked_array(normal(100), normal(100) > 0), {}, "p: some of it is masked"),
        (normal(100, 1.0), {"seed": 2**70}, "seed is .*: it must be a whole number, between 0 and 4294967295"),
        (normal(100, 1.0), {"resampling": 3}, "resampling is a int"),
    ],
)
def test_what_is_no_log_is_refused(p, given, message):
    with pytest.raises(TrafficError, match=message) as caught:
        traffic.kl_divergence.__wrapped__(p, normal(100, seed=9), **({"resampling": SHORT} | given))
    assert "\n" not in str(caught.value)
