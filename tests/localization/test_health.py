"""The state machine, scan by scan, and Eq. 8 beside it."""

import jax.numpy as jnp
import jaxlie
import numpy as np
import pytest

from urbanjax.localization import health
from urbanjax.localization.health import HealthParams
from urbanjax.localization.types import Health
from urbanjax.types import as_arrays

PARAMS = as_arrays(HealthParams(predict_time=0.55, lane_time=1.05, stop_time=0.45))
N, P, L, R, S = (int(state) for state in Health)


SCORES = {".": 0.4, "?": 0.8, "x": 1.5, "!": 1.5}  # good, doubtful, failed, failed and adrift


def states(scans: str, has_lane: bool = False, searched: bool = False) -> list[int]:
    now, seen = health.init().replace(searched=jnp.asarray(searched)), []
    for mark in scans:
        now = health.advance(
            now,
            jnp.asarray(SCORES[mark]),
            adrift=jnp.asarray(mark == "!"),
            has_lane=jnp.asarray(has_lane),
            period=0.1,
            params=PARAMS,
        )
        seen.append(int(now.health))
    return seen


@pytest.mark.parametrize(
    ("failed", "has_lane", "expected"),
    [
        ("....", False, [N, N, N, N]),
        ("x...", False, [P, P, P, N]),
        ("x.x...", False, [P, P, P, P, P, N]),
        ("xxxxxxxxxxx", False, [P] * 5 + [R] * 4 + [S] * 2),
        ("xxxxxxxxxxxxxxx", True, [P] * 5 + [L] * 5 + [R] * 4 + [S]),
        ("xxxxxxxxxxx...", False, [P] * 5 + [R] * 4 + [S] * 2 + [R, R, N]),
    ],
)
def test_states(failed, has_lane, expected):
    assert states(failed, has_lane) == expected


def test_what_is_doubtful_does_not_begin_a_failure_and_does_not_end_one():
    assert states("????") == [N] * 4
    assert states("x?????...") == [P] * 5 + [R] * 3 + [N]


def test_after_a_search_good_registrations_are_enough():
    assert states("x???", searched=True) == [P, P, P, N]


def test_a_scan_that_fits_nowhere_is_searched_for_at_once():
    assert states("!...") == [R, R, R, N]
    assert states("!...", has_lane=True) == [L, L, L, N]


def test_literal_gate_is_eq_8():
    here = jaxlie.SE3.identity()
    there = jaxlie.SE3.from_translation(jnp.array([3.0, 4.0, 0.0]))
    assert float(health.literal_gate(here, there, iterations=64, max_distance=3.0)) == pytest.approx(5 / 192)
    np.testing.assert_allclose(health.literal_gate(here, there, iterations=1, max_distance=2.5), 2.0)
