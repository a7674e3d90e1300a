"""Every racetrack of the data folder, and the lattice of Berlin."""

import numpy as np
import pytest

from experiments.racetrack import study
from urbanjax.io import maps
from urbanjax.io.maps import MapError, racetrack

pytestmark = pytest.mark.real_data


@pytest.fixture(scope="module")
def folder(data_dir):
    path = data_dir / "maps" / "racetracks"
    if not path.is_dir():
        pytest.skip(f"no racetracks at {path}")
    return path


def test_all_tracks_load_as_circuits_within_their_borders(folder):
    tracks = [path for path in sorted(folder.glob("*.csv")) if not path.stem.endswith("_raceline")]
    assert len(tracks) >= 4
    for path in tracks:
        found, stated = maps.read(path), racetrack.parse(path)
        graph, origin = found.graph, np.array(found.graph.origin)
        assert stated.closed, path.name
        line = np.linalg.norm(np.diff(stated.position, axis=0, append=stated.position[:1]), axis=-1).sum()
        assert float(graph.length.sum()) == pytest.approx(line, rel=0.03), path.name
        np.testing.assert_array_equal(graph.successor[:, 0], np.roll(np.arange(len(found.ids)), -1))
        width = np.linalg.norm(np.asarray(graph.left - graph.right, float), axis=-1)
        assert width.max() <= (stated.right + stated.left).max() + 0.05
        assert width.mean() > 0.95 * (stated.right + stated.left).mean()
        direction = np.stack([np.cos(graph.heading), np.sin(graph.heading)], -1)[:, :-1]
        for border in (graph.left, graph.right):
            assert np.all(np.sum(np.diff(np.asarray(border), axis=1) * direction, -1) > 0), path.name
        points = np.asarray(graph.centre).reshape(-1, 2) + origin
        away = np.linalg.norm(points[:, None] - stated.position[None], axis=-1).min(1)
        assert away.max() < (stated.right + stated.left).max() / 2


def test_race_lines_are_no_tracks(folder):
    for path in folder.glob("*_raceline.csv"):
        with pytest.raises(MapError, match="column"):
            maps.read(path)


def test_the_lattice_of_berlin_builds_within_a_second_and_its_lap_is_dijkstras(folder):
    lap = study.solve(study.RacetrackStudy(file=str(folder / "traj_ltpl_cl_berlin.csv"), runs=3))
    numbers = lap.numbers
    assert numbers["build_median_ms"] < 1000
    assert numbers["nodes"] > 2000
    assert numbers["dijkstra_difference_m"] < 1e-5
    assert numbers["soft_least_m"] <= numbers["soft_cost_m"] <= numbers["cost_m"]
    assert numbers["soft_slope_difference"] < 1e-6
    assert numbers["lap_bending_1pm"] < numbers["middle_bending_1pm"]
    assert numbers["lap_greatest_curvature_1pm"] < 0.12
