"""Scenes: what is drawn of them, and what is refused."""

import dataclasses

import pytest

from urbanjax.evaluation.missions.mission import ROADS
from urbanjax.tuning import SceneParams
from urbanjax.tuning.scenes import APART, scenes
from urbanjax.types import ConfigError

PARAMS = SceneParams(missions=("overtake", "cut_in"), traffic=("idm", "assertive"), roads=(1, 5), count=40, latest=6.0)


def test_all_that_is_asked_comes_and_nothing_else():
    found = scenes(PARAMS, seed=3)
    assert [scene.mission for scene in found] == ["overtake", "cut_in"] * 20
    assert {scene.traffic for scene in found} == {"idm", "assertive"}
    assert {scene.seed % ROADS for scene in found} == {1, 5}
    assert {scene.moment for scene in found} == {0.0, APART, 2 * APART}
    assert len({(scene.mission, scene.seed) for scene in found}) == 40


def test_a_seed_draws_the_same_and_another_one_others():
    assert scenes(PARAMS, seed=3) == scenes(PARAMS, seed=3)
    assert not set(scenes(PARAMS, seed=3)) & set(scenes(PARAMS, seed=4))


def test_fewer_scenes_are_the_first_of_more():
    assert scenes(dataclasses.replace(PARAMS, count=7), seed=3) == scenes(PARAMS, seed=3)[:7]


def test_other_roads_share_no_drive():
    others = dataclasses.replace(PARAMS, roads=(0, 2))
    assert not {scene.road for scene in scenes(PARAMS, seed=3)} & {scene.road for scene in scenes(others, seed=3)}


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"missions": ("overtake", "district")}, "differ in size"),
        ({"missions": ("overtaking",)}, "overtaking"),
        ({"traffic": ("replay",)}, "idm"),
        ({"roads": (16,)}, "15"),
    ],
)
def test_what_is_not_there_is_said(changes, told):
    with pytest.raises(ConfigError, match=told):
        scenes(dataclasses.replace(PARAMS, **changes), seed=0)
