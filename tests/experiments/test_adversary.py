"""What the search for failures writes is what the evaluation drives again."""

import json

import pytest

from experiments.evaluate.study import EvaluateStudy, jobs_of, missions_of
from experiments.tune.adversary import study
from urbanjax.drivers import ConstantVelocity
from urbanjax.evaluation.missions.found import FoundScene
from urbanjax.io.runs.found_file import read_found, write_found
from urbanjax.rollout import LoopParams
from urbanjax.types import ConfigError

SCENES = [
    FoundScene("braking_leader", {"braking": 7.5, "time_gap": 0.6}),
    FoundScene("braking_leader", {"time_gap": 2.0}),
]


def test_the_evaluation_asks_each_scene_of_a_file_once(tmp_path):
    write_found(tmp_path / "found.json", SCENES, about="two")
    asked = EvaluateStudy(missions=(), found=str(tmp_path / "found.json"))
    jobs = jobs_of(asked, missions_of(asked), "idm")
    assert [(job.mission.name, job.seed) for job in jobs] == [("found_braking_leader", 0), ("found_braking_leader", 1)]


def test_a_wrong_file_is_named_before_anything_is_driven(tmp_path):
    (tmp_path / "found.json").write_text(json.dumps({"scenes": 3}), encoding="utf-8")
    with pytest.raises(ConfigError, match=r"found\.json: needs a list"):
        missions_of(EvaluateStudy(missions=(), found=str(tmp_path / "found.json")))


def test_a_round_trip_through_a_file_drives_to_the_same_end(tmp_path):
    loop = LoopParams().replace(driver=ConstantVelocity())
    write_found(tmp_path / "found.json", SCENES, about="two")
    ours, theirs = (
        study.confirmed(loop, scenes, logs=False) for scenes in (SCENES, read_found(tmp_path / "found.json"))
    )
    told = [[(one.row["cause"], one.row["cause_time_s"]) for one in each] for each in (ours, theirs)]
    assert told[0] == told[1]
    assert ours[0].row["competition_at_fault"] == 1
    assert not ours[0].row["success"]
    assert study.confirmation("constant_velocity", ours)["constant_velocity_found"] == 2


def test_quotients_are_of_sums_over_families_with_seeds_paired():
    class Counted(study.Quarry):
        def __init__(self):  # no hunts
            object.__setattr__(self, "driver", "stack")

        def counts(self, search):
            return {"values": [20, 30], "random": [2, 5]}[search]

    found = study.ratio([Counted(), Counted()], "stack", ours="values", against="random")
    assert (found.value, found.low, found.high) == pytest.approx((50 / 7, 6, 10))
