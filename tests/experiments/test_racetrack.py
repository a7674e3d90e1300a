"""The racetrack study on a track made up: its checks, its errors, its figures."""

import numpy as np
import pytest
from PIL import Image

from experiments.racetrack import figures as racetrack_figures
from experiments.racetrack import study as racetrack
from experiments.racetrack.study import BARRED, RacetrackStudy
from urbanjax.io.figures import lattices
from urbanjax.io.figures.style import figure
from urbanjax.planning.lattice.course_lattice import CourseLatticeParams
from urbanjax.types import ScenarioError

COARSE = RacetrackStudy(lattice=CourseLatticeParams(lateral_spacing=1.6), runs=1)


@pytest.fixture(scope="module")
def lap():
    return racetrack.solve(COARSE)


def test_the_lap_is_dijkstras_and_the_soft_value_keeps_its_bounds(lap):
    numbers = lap.numbers
    assert numbers["dijkstra_difference_m"] < 1e-8
    assert numbers["soft_least_m"] < numbers["soft_cost_m"] < numbers["cost_m"]
    assert numbers["soft_slope_difference"] < 1e-6
    expected = numbers["lap_length_m"] + COARSE.bending * numbers["lap_bending_1pm"]
    assert numbers["cost_m"] == pytest.approx(expected, rel=1e-9)
    assert numbers["lap_length_m"] < numbers["course_m"]
    assert all(np.isfinite(x) for x in numbers.values())


def test_the_table_of_the_lap_is_in_map_coordinates(lap):
    rows = racetrack.path_table(lap)
    way = np.hypot(np.diff(rows["x_m"]), np.diff(rows["y_m"]))
    assert way.sum() + np.hypot(rows["x_m"][0] - rows["x_m"][-1], rows["y_m"][0] - rows["y_m"][-1]) == pytest.approx(
        lap.numbers["lap_length_m"], rel=2e-3
    )
    track = racetrack.made_up()
    places = np.stack([rows["x_m"], rows["y_m"]], -1)
    away = np.linalg.norm(places[:, None] - track.position[None], axis=-1).min(1)
    assert away.max() < 6.2


def test_oracles_count_and_search_a_lattice_drawn_by_hand():
    cost = np.full((3, 2, 2), BARRED)
    cost[0], cost[1, 0, 0], cost[2] = [[1.0, 2.0], [4.0, 8.0]], 1.0, [[1.0, 5.0], [0.5, 0.5]]
    assert racetrack.dijkstra(cost, closed=True) == 3.0
    assert racetrack.dijkstra(cost, closed=False) == 3.0
    cost[0, 0, 0] = 50.0
    assert racetrack.dijkstra(cost, closed=True) == 10.0
    assert racetrack.dijkstra(cost, closed=False) == 6.0
    assert np.exp(racetrack.log_paths(cost, closed=True)) == pytest.approx(2.0)
    assert np.exp(racetrack.log_paths(cost, closed=False)) == pytest.approx(4.0)


def test_a_track_that_the_vehicle_cannot_turn_on_is_told():
    limits = COARSE.lattice.limits.replace(max_curvature=0.001)
    with pytest.raises(ScenarioError, match="no path leads through the lattice"):
        racetrack.solve(COARSE.replace(lattice=COARSE.lattice.replace(limits=limits)))


@pytest.mark.parametrize("name", ["course", pytest.param("macro", marks=pytest.mark.slow)])
def test_the_figures_show_the_lattice_and_the_path(lap, tmp_path, name):
    path = tmp_path / "lattice.png"
    if name == "course":
        racetrack_figures.draw_course(lap, path)
    else:
        racetrack_figures.draw_macro(path, 0.5)
    picture = np.asarray(Image.open(path).convert("RGB"), int)
    red = (picture[..., 0] > 170) & (picture[..., 1] < 90)  # the path
    assert red.sum() > 100
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 50


def test_nodes_are_coloured_by_weight_and_only_those_there_are_drawn(tmp_path):
    position = np.stack(np.meshgrid(np.arange(3.0), np.arange(4.0), indexing="ij"), -1)
    weight = np.zeros((3, 4))
    weight[:, 1] = 1.0
    there = np.ones((3, 4), bool)
    there[:, 3] = False
    with figure(tmp_path / "lattice.png", 3.0, height=3.0) as canvas:
        axes = canvas.subplots()
        dots = lattices.draw_lattice(axes, position, weight=weight, there=there)
        np.testing.assert_array_equal(np.sort(dots.get_offsets(), axis=0), position[:, 1])
        assert len(axes.collections[0].get_offsets()) == 9
