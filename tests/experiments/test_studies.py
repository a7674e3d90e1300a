"""The studies' tables and figures, on made-up results; and what each experiment takes from its command line."""

import importlib

import numpy as np
import pytest
from PIL import Image

from experiments.common.overtaking import Fig10, OvertakeStudy
from experiments.highway import figures as highway_figures
from experiments.highway import study as highway
from experiments.overtake import figures as overtake_figures
from experiments.overtake import study as overtake
from urbanjax.io.bridges.highway.episode import Episode
from urbanjax.roadmap.builders import straight
from urbanjax.types import ConfigError, Objects, config
from urbanjax.vehicle.params import VehicleParams


@pytest.fixture
def study():
    """Two values of tau and three starts, of which the last is crowded and collides without the clamp."""
    time = np.linspace(0.0, 4.0, 41)
    taus, crowded = np.array([0.0, 1.0]), np.array([False, False, True])
    shape = (2, 2, 3)
    speed = np.broadcast_to(8.0 + taus[:, None, None, None] * np.ones((2, 2, 3, 1)), (*shape, 41)) + 0.0
    way = speed * time
    ego = np.zeros((*shape, 41, 3))
    ego[..., 0] = 60.0 + way
    ego[..., 1] = 3.5 * np.sin(np.pi * time / 4)
    others = np.zeros((*shape, 41, 2, 5))
    others[..., 3:] = 4.7, 1.9
    others[..., 0, 0] = 80.0 + 4 * time
    others[..., 1, 0], others[..., 1, 1] = 40.0 + 9 * time, 3.5
    collided = np.zeros(shape, bool)
    collided[1, 1, 2] = True
    return Fig10(
        taus=taus,
        crowded=crowded,
        time=time,
        speed=speed,
        way=way,
        ego=ego,
        others=others,
        present=np.array([[True, False], [True, False], [True, True]]),
        collided=collided,
        completed=np.broadcast_to(~crowded, shape),
        drop=np.broadcast_to(np.array([1.0, 3.0, 8.0]), shape) * (2 - taus)[:, None, None],
        ttc=np.full(shape, 2.0),
        off_road=np.zeros(shape, bool),
        vehicle=VehicleParams(),
    )


def test_table_of_the_overtaking_study(study):
    rows = overtake.table(study)
    assert rows["tau"] == [0.0, 1.0]
    assert rows["progress [m]"] == pytest.approx([32.0, 36.0])
    assert rows["speed drop [m/s]"] == pytest.approx([8.0, 4.0])
    assert rows["speed drop, lane free [m/s]"] == pytest.approx([4.0, 2.0])
    assert rows["completed [%]"] == pytest.approx([200 / 3] * 2)
    assert rows["completed, lane free [%]"] == pytest.approx([100.0] * 2)
    assert rows["collisions"] == [0, 0]
    assert rows["collisions, no clamp"] == [0, 1]
    sideways = overtake.by_tau(rows)
    assert sideways["tau 1"][sideways[""].index("collisions, no clamp")] == 1
    flat = overtake.summary(study)
    assert flat["tau_1_no_clamp_collisions"] == 1
    assert flat["tau_0_progress_m"] == pytest.approx(32.0)
    assert flat["starts_lane_free"] == 2
    assert flat["tau_1_progress_gain_m"] == pytest.approx(4.0)
    assert flat["tau_1_no_clamp_collisions_share_low"] < 1 / 3 < flat["tau_1_no_clamp_collisions_share_high"]
    shown = overtake.with_intervals(study)
    row = shown[""].index("progress [m]")
    assert shown["tau 1"][row].startswith("36.0 [")
    assert len(overtake.starts(study)["tau"]) == 12


def test_without_a_free_lane_there_is_no_mean_over_free_lanes(study):
    import dataclasses

    rows = overtake.table(dataclasses.replace(study, crowded=np.ones(3, bool)))
    assert rows["speed drop, lane free [m/s]"] == [None, None]
    assert rows["completed, lane free [%]"] == [None, None]


def test_figures_of_the_overtaking_study_are_drawn(study, tmp_path):
    start = overtake_figures.exemplar(study)
    assert not study.crowded[start]
    overtake_figures.draw_fig10(study, tmp_path / "fig10.png", start)
    overtake_figures.draw_means(study, tmp_path / "means.png")
    for name in ("fig10.png", "means.png"):
        with Image.open(tmp_path / name) as image:
            assert np.asarray(image.convert("L")).std() > 5.0
    frames = overtake_figures.pictures(study, straight(2, 200.0), start, 20)
    assert len(frames) == 3
    assert frames[0].shape == (160, 720, 3)  # one strip per tau
    assert not np.array_equal(frames[0], frames[-1])


def episode(env, driver, seed, speed, collision=False, off=False):
    time = np.linspace(0.0, 2.0, 31)
    position = np.stack([speed * time, 0 * time], -1)
    there = np.ones((31, 1))
    at = np.tile(np.array([500.0, 0.0]), (31, 1, 1))
    others = Objects(at, 0 * there, 0 * there, 5 * there, 2 * there, valid=there > 0)
    on_road = np.full(31, not off)
    ones = np.ones(31)
    return Episode(
        env, driver, seed, 2.0, time, position, 0 * ones, speed * ones, on_road, others, collision, [0.01] * 30, []
    )


def test_table_of_the_highway_study(tmp_path):
    episodes = [
        episode("highway-v0", "stack", 0, 22.0),
        episode("highway-v0", "stack", 1, 24.0, collision=True),
        episode("highway-v0", "IDM", 0, 21.0),
        episode("highway-v0", "IDM", 1, 20.0, off=True),
    ]
    rows = highway.scores(episodes, duration=2.0)
    assert rows["mean_speed_mps"] == pytest.approx([22.0, 24.0, 21.0, 20.0])
    assert rows["least_ttc_s"][0] == pytest.approx((495.0 - 44.0) / 22.0, rel=1e-4)
    table = highway.table(rows)
    assert table["driver"] == ["stack", "IDM"]
    assert table["collisions"] == [1, 0]
    assert table["off the road"] == [0, 1]
    assert [text.split()[0] for text in table["mean speed [m/s]"]] == ["23.00", "20.50"]
    assert table["collisions [%]"][0] == "50.0 [9.5, 90.5]"
    assert table["step [ms]"][0] == pytest.approx(10.0)
    flat = highway.summary(rows)
    assert flat["highway-v0_stack_collisions"] == 1
    assert flat["highway-v0_idm_mean_speed_mps"] == pytest.approx(20.5)
    assert flat["highway-v0_idm_mean_speed_mps_low"] == 20.0
    assert flat["highway-v0_stack_collisions_share_high"] == pytest.approx(0.905, abs=1e-3)
    assert flat["highway-v0_faster_than_idm_mps"] == pytest.approx(2.5)
    assert len(highway.tracks(episodes)["time_s"]) == 4 * 31
    highway_figures.draw(rows, tmp_path / "highway.png")
    assert (tmp_path / "highway.png").stat().st_size > 5000


STUDIES = {
    "overtake": ("experiments.common.overtaking", "OvertakeStudy"),
    "highway": ("experiments.highway.study", "HighwayStudy"),
    "candidates": ("experiments.candidates.study", "CandidateStudy"),
    "benchmark": ("experiments.benchmark.study", "BenchStudy"),
    "demo": ("experiments.demo.study", "DemoStudy"),
    "localize": ("experiments.localize.study", "LocalizeStudy"),
    "register": ("experiments.register.study", "RegisterStudy"),
}


@pytest.mark.parametrize("name", STUDIES)
def test_presets_override_only_what_a_study_has(name):
    import yaml

    from tests.conftest import REPOSITORY

    module, cls = STUDIES[name]
    params = getattr(importlib.import_module(module), cls)
    assert config.to_params(params, config.schema(params)) == params()
    presets = list((REPOSITORY / "configs" / name / "preset").glob("*.yaml"))
    assert presets
    for preset in presets:
        values = yaml.safe_load(preset.read_text())
        assert config.to_params(params, values, source=preset.name) != params()


def test_a_key_of_the_stack_is_named_with_its_nearest():
    with pytest.raises(ConfigError, match=r"nearest valid key is 'stack.behavior'"):
        config.to_params(OvertakeStudy, {"stack": {"behavor": {"tau": 1.0}}})
    tree = config.schema(OvertakeStudy)
    assert "stack.behavior.gvp.tau" in config.nearest("stack.behavor.tau", config.keys(tree))


def test_pictures_can_be_left_out():
    assert config.to_params(highway.HighwayStudy, {"gif_every": 0}).gif_every == 0
    assert config.to_params(OvertakeStudy, {"gif_every": 0}).gif_every == 0
