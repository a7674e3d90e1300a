"""Lane changes that last, and lanes from lateral positions."""

import jax
import jax.numpy as jnp
import numpy as np

from urbanjax.traffic.flow.lane_changes import lane_changes, lanes_of

find, place = jax.jit(lane_changes), jax.jit(lanes_of)
TIME = np.float32(0.5 * np.arange(20))
ALL = np.ones(20, bool)
LANE = np.int32([1, 1, 1, 2, 1, 1, 2, 2, 2, 2, 2, 3, 4, 4, 4, 4, 4, 4, 4, 1])


def test_only_changes_that_last_count_at_their_first_sample():
    found = find(LANE, TIME, mask=ALL, hold=1.0)
    np.testing.assert_array_equal(np.flatnonzero(found.at), [6, 12])
    np.testing.assert_array_equal(found.step[found.at], [1, 2])
    np.testing.assert_array_equal(found.lane, [1] * 6 + [2] * 6 + [4] * 8)
    assert found.count == 2
    assert found.begun


def test_without_a_hold_every_change_counts():
    found = find(LANE, TIME, mask=ALL, hold=0.0)
    np.testing.assert_array_equal(np.flatnonzero(found.at), np.flatnonzero(np.diff(LANE)) + 1)
    np.testing.assert_array_equal(found.lane, LANE)
    assert not found.begun


def test_missing_samples_neither_confirm_nor_end_a_change():
    mask = ALL.copy()
    mask[[0, 7, 8, 13]] = False
    lane = np.where(mask, LANE, 9).astype(np.int32)
    found = find(lane, np.where(mask, TIME, np.nan).astype(np.float32), mask=mask, hold=1.0)
    np.testing.assert_array_equal(np.flatnonzero(found.at), [6, 12])
    assert find(lane, TIME, mask=np.zeros(20, bool), hold=1.0).count == 0


def test_the_numbering_and_padding_do_not_matter():
    mask = np.arange(26) < 20
    lane, time = np.pad(-3 * LANE, (0, 6)), np.pad(TIME, (0, 6))
    found = find(lane, time, mask=mask, hold=1.0)
    np.testing.assert_array_equal(np.flatnonzero(found.at), [6, 12])
    np.testing.assert_array_equal(found.step[found.at], [-3, -6])


def test_a_batch_of_vehicles():
    lanes = jnp.stack([LANE, LANE[::-1]])
    found = jax.jit(jax.vmap(lambda lane: lane_changes(lane, jnp.asarray(TIME), mask=jnp.asarray(ALL))))(lanes)
    np.testing.assert_array_equal(found.count, [2, 3])


def test_a_lane_is_left_when_its_border_is_behind_by_the_margin():
    borders = np.float32([-1.75, 1.75, 5.25])
    offset = np.float32([0, 1.8, 1.7, 1.9, 2.0, 1.6, 2.2, 1.5, 1.4, 9.0, -9.0])
    lane = place(offset, np.ones(11, bool), borders=borders, margin=0.3)
    np.testing.assert_array_equal(lane, [1, 1, 1, 1, 1, 1, 2, 2, 1, 3, 0])
    np.testing.assert_array_equal(
        place(offset, np.ones(11, bool), borders=borders, margin=0.0), np.searchsorted(borders, offset)
    )
    mask = np.array([0, 1, 1, 1, 1, 1, 0, 1, 1, 1, 1], bool)
    again = place(np.where(mask, offset, np.nan), mask, borders=borders, margin=0.3)
    np.testing.assert_array_equal(again, [2, 2, 2, 2, 2, 2, 2, 2, 1, 3, 0])
