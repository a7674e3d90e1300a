"""Straights and curves of a stadium, of an S and of lines that have none."""

import numpy as np
import pytest

from urbanjax.traffic.course.sections import SectionParams, sections
from urbanjax.types.errors import TrafficError


def driven(*pieces, step=2.0):
    """A line of (metres, curvature) pieces."""
    rates = np.concatenate([np.full(round(length / step), curvature) for length, curvature in pieces])
    heading = np.concatenate([[0.0], np.cumsum(rates * step)])[:-1] + 0.5 * rates * step
    steps = step * np.stack([np.cos(heading), np.sin(heading)], -1)
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


TURN = 40 * np.pi
STADIUM = driven((200, 0), (TURN, 1 / 40), (200, 0), (TURN, 1 / 40))[:-1]


def rows(found):
    return {name: (float(a), float(b)) for name, a, b in zip(found.names, found.start, found.end, strict=True)}


def test_a_stadium_has_two_straights_and_two_curves():
    found = rows(sections(STADIUM, SectionParams()))
    assert sorted(found) == ["curve_1", "curve_2", "straight_1", "straight_2"]
    assert found["straight_1"] == pytest.approx((0, 200), abs=10)
    assert found["curve_1"] == pytest.approx((200, 200 + TURN), abs=10)
    assert found["straight_2"] == pytest.approx((200 + TURN, 400 + TURN), abs=10)
    start, end = found["curve_2"]
    assert start == pytest.approx(400 + TURN, abs=10)
    assert 0 < end < 10, "it goes on over the start"


def test_areas_cover_the_course_once():
    for line, closed in ((STADIUM, True), (driven((100, 0), (60, 0.02), (60, -0.02), (100, 0)), False)):
        found = sections(line, SectionParams(), closed=closed)
        whole = np.concatenate([line, line[:1]]) if closed else line
        length = np.linalg.norm(np.diff(whole, axis=0), axis=1).sum()
        size = (np.asarray(found.end) - np.asarray(found.start)) % length
        assert size.sum() == pytest.approx(length, rel=1e-5)
        assert size.min() >= 29
        order = np.argsort(found.start)
        np.testing.assert_allclose(
            np.asarray(found.end)[order] % length, np.roll(np.asarray(found.start)[order], -1) % length, atol=1e-3
        )


def test_where_the_start_is_does_not_matter():
    base = rows(sections(STADIUM, SectionParams()))
    turned = rows(sections(np.roll(STADIUM, -150, axis=0), SectionParams()))
    sizes = [sorted((b - a) % (400 + 2 * TURN) for a, b in found.values()) for found in (base, turned)]
    np.testing.assert_allclose(sizes[0], sizes[1], atol=2.1)


def test_left_and_right_are_two_curves_if_asked_for():
    line = driven((100, 0), (60, 0.02), (60, -0.02), (100, 0))
    assert sections(line, SectionParams(), closed=False).names == ("straight_1", "curve_1", "curve_2", "straight_2")
    one = sections(line, SectionParams(split=False, window=4.0), closed=False)
    assert one.names == ("straight_1", "curve_1", "straight_2")
    assert float(one.end[1] - one.start[1]) == pytest.approx(120, abs=6)


def test_a_short_kink_belongs_to_the_straight_and_a_straight_line_is_one():
    kink = driven((100, 0), (10, 0.05), (100, 0))
    assert sections(kink, SectionParams(window=6.0), closed=False).names == ("straight_1",)
    assert sections(driven((100, 0)), SectionParams(), closed=False).names == ("straight_1",)


@pytest.mark.parametrize(
    ("line", "word"),
    [
        (np.zeros((2, 2)), "three finite points"),
        (np.array([[0, 0], [1, np.nan], [2, 0]]), "finite"),
        (np.array([[0.0, 0], [1, 0], [2, 0]]), "too short"),
    ],
)
def test_lines_without_sections_are_refused(line, word):
    with pytest.raises(TrafficError, match=word):
        sections(line, SectionParams(), closed=False)
