"""Frames that are known: pairs of points, whole laps, parts of them, several paths, and courses that fix no frame."""

import numpy as np
import pytest

from urbanjax.io import logs
from urbanjax.io.logs import LogError
from urbanjax.io.logs.align import LogAlignParams, align
from urbanjax.io.logs.frame import Frame, from_pairs


def course(n=400):
    """A closed line [n, 2] m of no symmetry, about 1.2 km long."""
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    radius = 160 + 40 * np.cos(2 * angle + 0.4) + 25 * np.sin(3 * angle) + 12 * np.cos(5 * angle + 1)
    return radius[:, None] * np.stack([np.cos(angle), 0.8 * np.sin(angle)], -1)


LINE = course()
FRAMES = [Frame(1.0, False, 2.1, (300.0, -40.0)), Frame(1.0, True, -0.7, (-900.0, 2000.0)), Frame(1.0, False, 0.0)]


def seen(points, frame, noise=0.0, seed=0):
    """What a log in such a frame has where the vehicle is at points of the line."""
    return frame.inverse().apply(points) + np.random.default_rng(seed).normal(0, noise, points.shape)


@pytest.mark.parametrize("frame", [*FRAMES, Frame(0.3048, True, 3.0, (5.0, 6.0)), Frame(2.0, False, 3.1, (1e5, 2e5))])
def test_a_frame_and_its_inverse_undo_each_other_and_turn_headings(frame):
    points = np.random.default_rng(0).normal(0, 100, (30, 2))
    np.testing.assert_allclose(frame.inverse().apply(frame.apply(points)), points, atol=1e-8)
    heading = np.linspace(-3, 3, 30)
    ahead = points + np.stack([np.cos(heading), np.sin(heading)], -1)
    way = (frame.apply(ahead) - frame.apply(points)) / frame.scale
    np.testing.assert_allclose(way, np.stack([f(frame.heading(heading)) for f in (np.cos, np.sin)], -1), atol=1e-9)
    log = logs.from_arrays("a", np.arange(30), position=points, speed=np.ones(30), heading=heading)
    mapped = frame.log(log)
    np.testing.assert_allclose(mapped.speed, frame.scale)
    np.testing.assert_array_equal(mapped.heading, frame.heading(heading))


@pytest.mark.parametrize("frame", FRAMES)
def test_pairs_of_points_give_their_frame(frame):
    frame = Frame(1.3, frame.reflected, frame.rotation, frame.translation)
    found, distance = from_pairs(frame.inverse().apply(LINE), LINE, reflection="either", scale=(0.5, 2.0))
    np.testing.assert_allclose(found.apply(np.eye(2)), frame.apply(np.eye(2)), atol=1e-8)
    assert found.reflected == frame.reflected
    assert distance.max() < 1e-9
    limited, _ = from_pairs(frame.inverse().apply(LINE), LINE, reflection="either", scale=(0.9, 1.1))
    assert limited.scale == pytest.approx(1.1)


def test_the_frame_of_noisy_pairs_is_that_of_least_squares():
    pairs = seen(LINE, FRAMES[0], 1.0), LINE
    found, distance = from_pairs(*pairs)
    best = np.sum(distance**2)
    for change in ((1e-4, 0, 0), (-1e-4, 0, 0), (0, 1e-2, 0), (0, -1e-2, 0), (0, 0, 1e-2), (0, 0, -1e-2)):
        other = Frame(
            1.0, False, found.rotation + change[0], (found.translation[0] + change[1], found.translation[1] + change[2])
        )
        assert np.sum((other.apply(pairs[0]) - LINE) ** 2) > best


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("part", [(0, 400), (37, 237), (300, 520), (390, 10)])
def test_a_lap_or_a_part_of_one_finds_its_frame(frame, part):
    step = 1 if part[1] > part[0] else -1  # the last is driven against the line
    way = LINE[np.arange(part[0], part[1], step) % 400]
    found = align(seen(way, frame, 0.3), LINE, closed=True, params=LogAlignParams(reflection="either", starts=8))
    assert found.frame.reflected == frame.reflected
    assert found.frame.scale == pytest.approx(1.0)
    off = np.linalg.norm(found.frame.apply(seen(way, frame)) - way, axis=-1)
    assert off.max() < 0.5
    assert found.rms < 0.4
    assert not found.ambiguous
    assert found.second_rms > 1.5 * found.rms
    assert found.coverage == pytest.approx(len(way) / 400, abs=0.06)


def test_several_laps_in_one_path_find_their_frame():
    way = LINE[np.arange(60, 1060) % 400]
    found = align(seen(way, FRAMES[0], 0.3), LINE, closed=True)
    assert np.linalg.norm(found.frame.apply(seen(way, FRAMES[0])) - way, axis=-1).max() < 0.3
    assert not found.ambiguous


def test_scale_is_found_within_its_limits():
    frame = Frame(1.07, False, 1.0, (20.0, 30.0))
    found = align(seen(LINE, frame), LINE, closed=True, params=LogAlignParams(scale_limit=1.2))
    assert found.frame.scale == pytest.approx(1.07, abs=1e-3)
    assert found.rms < 0.05
    fixed = align(seen(LINE, frame), LINE, closed=True)
    assert fixed.frame.scale == pytest.approx(1.0)
    assert fixed.rms > 3.0


def test_paths_in_one_frame_are_aligned_together_and_strays_do_not_count():
    paths = [seen(LINE[a:b], FRAMES[0], 0.2, a) for a, b in ((0, 150), (120, 260), (230, 400))]
    stray = seen(np.stack([np.linspace(60, 120, 20), np.zeros(20)], -1), FRAMES[0])  # into a pit
    found = align([*paths, stray], LINE, closed=True, params=LogAlignParams(keep=0.9))
    off = np.concatenate([found.frame.apply(p) for p in paths]) - np.concatenate(
        [LINE[:150], LINE[120:260], LINE[230:]]
    )
    assert np.linalg.norm(off, axis=-1).max() < 1.2
    assert np.abs(off.mean(0)).max() < 0.3
    assert found.rms < 0.5


def test_a_line_that_is_a_part_of_the_path_finds_the_frame():
    found = align(seen(LINE, FRAMES[0]), LINE[100:250], closed=False, params=LogAlignParams(keep=0.35, starts=24))
    off = found.frame.apply(seen(LINE[120:230], FRAMES[0])) - LINE[120:230]
    assert np.linalg.norm(off, axis=-1).max() < 0.5


ANGLE = np.linspace(0, 2 * np.pi, 240, endpoint=False)
SYMMETRIC = {
    "circle": 100 * np.stack([np.cos(ANGLE), np.sin(ANGLE)], -1),
    "oval": np.stack([200 * np.cos(ANGLE), 90 * np.sin(ANGLE)], -1),
    "clover": (100 + 30 * np.cos(3 * ANGLE))[:, None] * np.stack([np.cos(ANGLE), np.sin(ANGLE)], -1),
}


@pytest.mark.parametrize("shape", SYMMETRIC)
def test_a_symmetric_course_is_ambiguous(shape):
    line = SYMMETRIC[shape]
    found = align(seen(line, FRAMES[0], 0.2), line, closed=True)
    assert found.ambiguous
    assert "ambiguous" in found.verdict
    assert found.rms < 0.4


def test_a_part_of_a_straight_road_is_ambiguous_along_it():
    road = np.stack([np.linspace(0, 500, 200), np.zeros(200)], -1)
    found = align(seen(road[50:120], FRAMES[0], 0.2), road, closed=False)
    assert found.ambiguous


def test_standing_noise_is_no_way():
    rest = np.repeat(LINE[:1], 2000, axis=0) + np.random.default_rng(2).normal(0, 0.05, (2000, 2))
    found = align(seen(np.concatenate([rest, LINE[:300]]), FRAMES[0]), LINE, closed=True)
    assert np.linalg.norm(found.frame.apply(seen(LINE[:300], FRAMES[0])) - LINE[:300], axis=-1).max() < 0.5


@pytest.mark.parametrize(
    ("paths", "line", "message"),
    [
        ([], LINE, "there are no paths"),
        (np.zeros((50, 2)), LINE, "path 0 has 1 different points"),
        (LINE * np.nan, LINE, r"path 0 \(400, 2\) is not"),
        (LINE[:, :1], LINE, r"path 0 \(400, 1\) is not"),
        (LINE, np.full((400, 2), np.inf), r"the line \(400, 2\) is not"),
        (LINE, LINE[:2], "the line has 2 different points"),
    ],
)
def test_what_is_no_curve_is_refused(paths, line, message):
    with pytest.raises(LogError, match=message):
        align(paths, line, closed=True)


@pytest.mark.parametrize(
    ("source", "target", "message"),
    [
        (LINE, LINE[1:], "are not both"),
        (LINE * np.nan, LINE, "finite"),
        (LINE * 0, LINE, "one point"),
        (LINE[:1], LINE[:1], "n > 1"),
    ],
)
def test_pairs_that_fix_no_frame_are_refused(source, target, message):
    with pytest.raises(LogError, match=message):
        from_pairs(source, target)
