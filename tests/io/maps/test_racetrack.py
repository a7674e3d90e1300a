"""Racetracks from CSV: known geometry, both formats, folds, typed errors, mutated files."""

import time

import jax
import numpy as np
import pytest

from urbanjax.course import course_between
from urbanjax.io import maps
from urbanjax.io.maps import MapError, racetrack
from urbanjax.roadmap.corridor import CorridorParams

TUM, LTPL = "tum", "ltpl"


def circle(radius=40.0, n=90, right=3.0, left=5.0):
    """Columns x, y, right, left of a circle driven to the left."""
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), right + 0 * angle, left + 0 * angle], -1)


def text(rows, form=TUM):
    """A file of the racetrack database, or one of graph-ltpl, whose last row is its first again."""
    if form == TUM:
        lines = [",".join(f"{x:.6f}" for x in row) for row in rows]
        return "\n".join(["# x_m,y_m,w_tr_right_m,w_tr_left_m", *lines, ""])
    names = "x_ref_m; y_ref_m; width_right_m; width_left_m; x_normvec_m; y_normvec_m; alpha_m; s_racetraj_m"
    lines = ["; ".join(f"{x:.7f}" for x in (*row, 0.0, 1.0, 0.1, k)) for k, row in enumerate([*rows, rows[0]])]
    return "\n".join(["# ae044b34", f"# {names}", *lines, ""])


def write(folder, content, name="track.csv"):
    path = folder / name
    path.write_text(content)
    return path


@pytest.mark.parametrize("form", [TUM, LTPL])
def test_a_circle_becomes_a_chain_of_links_round_it(tmp_path, form):
    found = maps.read(write(tmp_path, text(circle(), form)))
    graph = jax.tree.map(np.asarray, found.graph)
    assert found.format == "racetrack"
    assert found.faults == ()
    n = len(found.ids)
    np.testing.assert_array_equal(graph.successor[:, 0], np.roll(np.arange(n), -1))
    middle = 40.0 - 1.0  # the middle of the track lies a metre to the left
    assert graph.length.sum() == pytest.approx(2 * np.pi * middle, rel=2e-3)
    np.testing.assert_allclose(graph.curvature, 1 / middle, rtol=0.02)
    origin = np.array(found.graph.origin)
    for border, radius in ((graph.left, 35.0), (graph.right, 43.0)):
        np.testing.assert_allclose(np.linalg.norm(border + origin, axis=-1), radius, atol=0.03)
    np.testing.assert_allclose(graph.centre[:, -1], np.roll(graph.centre[:, 0], -1, axis=0), atol=1e-3)


def test_the_track_can_be_driven_round(tmp_path):
    found = maps.read(write(tmp_path, text(circle())))
    course = course_between(found.graph, 0, goal=len(found.ids) - 1, corridor=CorridorParams(lanes=1, n_stations=512))
    there = np.asarray(course.corridor.valid)
    assert float(course.corridor.length) == pytest.approx(2 * np.pi * 39.0, rel=2e-3)
    np.testing.assert_allclose(np.asarray(course.corridor.lane_width)[there], 8.0, atol=0.02)


def test_columns_are_found_by_their_names(tmp_path):
    rows = circle()[:, [3, 1, 0, 2]]
    lines = [",".join(map(str, row)) for row in rows]
    named = maps.read(write(tmp_path, "\n".join(["# w_tr_left_m,y_m,x_m,w_tr_right_m", *lines])))
    plain = maps.read(write(tmp_path, "\n".join(",".join(map(str, row)) for row in circle()), "plain.csv"))
    for name in ("centre", "left", "right"):
        np.testing.assert_array_equal(getattr(named.graph, name), getattr(plain.graph, name))


def test_an_open_track_does_not_close(tmp_path):
    found = maps.read(write(tmp_path, text(circle()[:45])))
    assert not found.graph.has_successor[len(found.ids) - 1].any()
    assert float(found.graph.length.sum()) == pytest.approx(np.pi * 39.0 * 44 / 45, rel=5e-3)


def test_borders_lie_within_the_track_and_do_not_fold_inside_a_bend(tmp_path):
    angle = np.linspace(0, 2 * np.pi, 240, endpoint=False)
    a, b = 60.0, 16.0  # an ellipse: radius b^2 / a = 4.3 m at its tips, where the border is 6 m away
    rows = np.stack([a * np.cos(angle), b * np.sin(angle), 4 + 0 * angle, 6 + np.cos(3 * angle)], -1)
    found = maps.read(write(tmp_path, text(rows)))
    graph = jax.tree.map(lambda x: np.asarray(x, float), found.graph)
    direction = np.stack([np.cos(graph.heading), np.sin(graph.heading)], -1)[:, :-1]
    for border in (graph.left, graph.right):
        assert np.all(np.sum(np.diff(border, axis=1) * direction, -1) > 0)
    points = (graph.left + np.array(found.graph.origin)).reshape(-1, 2)
    line = np.stack([a * np.cos(angle), b * np.sin(angle)], -1)
    away = np.linalg.norm(points[:, None] - line[None], axis=-1).min(1)
    assert away.max() < 7.0 + 0.05
    assert away.min() > 2.0


def row(k, line):
    """A fault in row k (from 0) of the file."""
    return lambda lines: [*lines[: k + 1], line, *lines[k + 2 :]]


FAULTS = {
    "no number": (row(4, "1.0,abc,3,3"), r"line 6, column 2 \(y\): 'abc' is no number"),
    "not finite": (row(4, "1.0,2.0,nan,3"), r"line 6, column 3 \(right\): nan is not within"),
    "infinite": (row(4, "inf,2.0,3,3"), r"line 6, column 1 \(x\): inf is not within"),
    "column missing": (row(4, "1.0,2.0,3"), "line 6, column 4: has 3 columns, the first row has 4"),
    "column too many": (row(4, "1.0,2.0,3,3,3"), "line 6, column 5: has 5 columns, the first row has 4"),
    "no width": (row(4, "1.0,2.0,-3,3"), r"line 6, columns 3 and 4 \(right and left\): the track is 0 m wide"),
    "much width": (row(4, "1.0,2.0,3,1e5"), r"line 6, column 4 \(left\): a width of 100000.0 m"),
    "jump": (row(4, "9000,2.0,3,3"), "line 6, columns x and y: 8961 m from the point before"),
    "spike": (row(44, "-39.0,8.0,3,3"), r"line 4\d, columns x and y: the line turns on less than 2 m"),
    "folded": (
        lambda lines: text(circle(left=300.0)).split("\n"),
        "column left: a width of 300 m on the inside of a be",
    ),
    "XML": (lambda lines: ["<commonRoad/>", *lines], "line 1: is XML, and a racetrack is a CSV"),
    "few points": (lambda lines: lines[:3], "line 3: 2 points, a track has 4 or more"),
    "one place": (lambda lines: [lines[0], *lines[1:2] * 9], "line 2: 1 different points"),
    "empty": (lambda lines: [], "line 1: 0 points"),
    "race line": (lambda lines: ["# x_m,y_m", *(x.rsplit(",", 2)[0] for x in lines[1:-1])], "line 2, column 'right'"),
    "two columns": (lambda lines: [x.rsplit(",", 2)[0] for x in lines[1:-1]], "line 1, column 3: is missing"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_told_with_file_line_and_column(tmp_path, name):
    change, message = FAULTS[name]
    path = write(tmp_path, "\n".join(change(text(circle()).split("\n"))))
    with pytest.raises(MapError, match=message) as error:
        maps.read(path)
    assert str(path) in str(error.value)


def test_what_is_no_text_and_what_is_not_there_is_told(tmp_path):
    path = tmp_path / "track.csv"
    with pytest.raises(maps.MapError.__base__, match="no such file"):
        maps.read(path)
    path.write_bytes(b"# x_m,y_m\n1,2,\xff\n")
    with pytest.raises(MapError, match="line 2: byte 0xff is no text"):
        maps.read(path)


def mutated(content, rng):
    """A copy with one or two random faults: bytes, cells, lines, the end."""
    data = bytearray(content.encode())
    for _ in range(rng.integers(1, 3)):
        at = int(rng.integers(len(data))) if data else 0
        kind = rng.integers(6)
        lines = bytes(data).split(b"\n")
        k = int(rng.integers(len(lines)))
        if kind == 0:
            data[at : at + 1] = bytes([int(rng.integers(48, 58) if rng.random() < 0.7 else rng.integers(256))])
        elif kind == 1:
            del data[at : at + int(rng.integers(1, 200))]
        elif kind == 2:
            data = data[: max(at, 1)]
        elif kind == 3:
            cell = rng.choice([b"1e30", b"-1", b"nan", b"", b"0", b"99999", b"1e-300", b"0x1", b",", b";;"])
            data[at : at + 4] = cell
        elif kind == 4:
            lines.insert(int(rng.integers(len(lines))), lines[k])
            data = bytearray(b"\n".join(lines))
        else:
            lines[k], lines[k // 2] = lines[k // 2], lines[k]
            data = bytearray(b"\n".join(lines))
    return bytes(data)


@pytest.mark.parametrize("form", [TUM, LTPL])
def test_a_hundred_mutated_files_load_or_name_their_fault(tmp_path, form):
    rng, content, refused = np.random.default_rng(7), text(circle(), form), 0
    path = tmp_path / "track.csv"
    maps.read(write(tmp_path, content))
    for _ in range(100):
        path.write_bytes(mutated(content, rng))
        began, message = time.process_time(), f"{path}: line "
        try:
            graph = maps.read(path).graph
            assert all(np.all(np.isfinite(x)) for x in (graph.centre, graph.left, graph.right, graph.curvature))
        except MapError as error:
            refused, message = refused + 1, str(error)
        assert message.startswith(f"{path}: line ")
        assert time.process_time() - began < 1.0
    assert 20 < refused < 95


def test_the_width_of_a_lane_follows_the_narrowest_place_smoothly():
    left = np.full(200, 5.0)
    left[90:95] = 3.0
    middle, half = racetrack._within(left, np.full(200, 5.0), closed=False)
    assert np.all(middle + half <= left + 1e-9)
    assert np.all(half - middle <= 5.0 + 1e-9)
    assert np.max(np.abs(np.diff(half, 2))) < 0.1
    assert half[50] == pytest.approx(5.0)
