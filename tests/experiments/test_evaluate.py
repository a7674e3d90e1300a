"""What the rows of an evaluation amount to, and what its command line refuses."""

import dataclasses
import json

import numpy as np
import pyarrow
import pyarrow.parquet
import pytest
import yaml

from experiments.common import recordings
from experiments.common.scenes import scenes
from experiments.evaluate import driving, replay, report, study, tables
from experiments.evaluate.study import EvaluateStudy
from tests.conftest import REPOSITORY
from tests.io.maps import texts
from urbanjax.drivers import DRIVERS
from urbanjax.evaluation.batch import Job, Outcome
from urbanjax.evaluation.missions import MISSIONS
from urbanjax.evaluation.traffic import MANNERS
from urbanjax.evaluation.verdict import Cause
from urbanjax.io.runs import directory
from urbanjax.types import ConfigError

PARTS = ("no_collision_at_fault", "drivable_area", "ttc_within_bound", "gated_ttc", "gate", "comfort")


def row(driver, mission, seed, success, score, cause="late", traffic="idm"):
    return {
        "localization": "given",
        "driver": driver,
        "traffic": traffic,
        "mission": mission,
        "seed": seed,
        "success": success,
        "cause": "success" if success else cause,
        "cause_time_s": np.nan if success else 3.0,
        "nuplan_total": score,
        "carla_total": 100 * score,
        "competition_total": 20.0,
        "competition_time": 15.0,
        "competition_reached": success,
        "competition_at_fault": int(cause == "hit moving" and not success),
        "competition_off_road": 0,
        **{f"nuplan_{name}": 1.0 for name in PARTS},
    }


ROWS = [
    *(row("stack", "overtake", seed, seed != 3, 0.9 if seed != 3 else 0.0, "hit moving") for seed in range(8)),
    *(row("stack", "cut_in", seed, True, 0.8) for seed in range(8)),
    *(row("idm", "overtake", seed, False, 0.5) for seed in range(8)),
    *(row("idm", "cut_in", seed, seed < 4, 0.7, "stood") for seed in range(8)),
]


def test_shares_means_and_causes_are_those_of_the_rows():
    head = tables.headline(ROWS)
    assert head["driver"] == ["stack", "idm"]
    assert head["success [%]"][0].startswith("93.8 [71.7, 98.9]")
    assert head["success [%]"][1].startswith("25.0")
    assert head["at-fault collision [%]"][0].startswith("6.2")
    table = tables.by_mission(ROWS)
    assert table["commonest causes of failure"] == ["hit moving 1", "-", "late 8", "stood 4"]
    assert tables.causes([r for r in ROWS if r["driver"] == "idm"]) == "late 8, stood 4"
    found = tables.summary(ROWS)
    assert found["drives"] == 32
    assert found["stack_idm_overtake_success_share"] == 7 / 8
    assert found["idm_idm_nuplan_score"] == pytest.approx(0.6)
    assert found["idm_idm_nuplan_score_low"] < 0.6 < found["idm_idm_nuplan_score_high"]


def test_differences_are_paired_by_start():
    found = tables.differences(ROWS[::-1][::-1])
    assert found["drivers"] == ["stack - idm"]
    assert found["pairs"] == [16]
    assert found["success [points]"][0].startswith("68.8")
    one, two = (tables.chosen(ROWS, driver=name) for name in ("stack", "idm"))
    assert tables.against(one, two[::-1]) == tables.against(one, two)
    assert tables.against(one[:3], two)["pairs"] == 3
    with pytest.raises(ConfigError, match="no start in common"):
        tables.against(one, tables.chosen(ROWS, driver="nobody"))


def test_each_score_is_shown_with_its_parts_and_the_order_that_it_gives():
    assert list(tables.scores(ROWS)) == ["nuplan", "carla", "competition"]
    told = tables.parts(ROWS, "nuplan")
    assert list(told) == [
        "driver",
        "traffic",
        "localization",
        "no collision at fault",
        "drivable area",
        "ttc within bound",
        "comfort",
    ]
    assert told["comfort"] == ["1.00 [1.00, 1.00]"] * 2
    dear = [{**r, "competition_total": 30.0 if r["driver"] == "stack" else 20.0} for r in ROWS]
    found = dict(zip(*(tables.orders(dear)[name] for name in ("by", "from best to worst")), strict=True))
    assert found["success"] == found["nuPlan score"] == "stack > idm"
    assert found["competition [s]"] == "idm > stack"
    alike = [{**r, "nuplan_total": 0.5 + 0.1 * (r["seed"] % 2 == (r["driver"] == "idm"))} for r in ROWS]
    assert "~" in tables.orders(alike)["from best to worst"][1]


def test_what_localization_costs_is_told_beside_the_same_drives_with_given_poses():
    told = {f"localization_{name}": 0.5 for name in ("mean_error_m", "not_normal_s", "stopped_s")}
    told |= {"localization_longest_unnoticed_s": 2.0, "localization": "scan_loss"}
    given = tables.chosen(ROWS, driver="stack")
    lost = [{**r, "mission": f"{r['mission']}_scan_loss", "success": r["seed"] > 3, **told} for r in given]
    found = tables.localizations([*given, *lost])
    assert found["localization"] == ["given", "scan_loss"]
    assert found["drives"] == [16, 16]
    assert found["success [%]"][1].startswith("50.0")
    assert found["mean error [m]"] == ["-", "0.50 [0.50, 0.50]"]
    assert found["wrong for 1 s while normal [%]"][1].startswith("100.0")
    assert found["success [points], less given"][0] == "-"
    assert found["success [points], less given"][1].startswith("-43.8")
    assert list(scenes(lost)) == list(scenes(given))
    mixed = tables.columns([*given, *lost])
    assert mixed["localization_longest_unnoticed_s"] == [None] * 16 + [2.0] * 16
    # Nothing pools drives of different kinds.
    assert tables.headline([*given, *lost])["drives"] == [16, 16]
    assert tables.by_mission([*given, *lost])["drives"] == [8] * 4
    flat = tables.summary([*given, *lost])
    assert flat["stack_idm_success_share"] == 15 / 16
    assert flat["stack_idm_scan_loss_success_share"] == 0.5


def test_localization_is_an_axis_of_the_stack():
    params = EvaluateStudy(missions=("cut_in", "overtake"), localization=("given", "map_gap"), seeds=2)
    names = ["cut_in", "overtake", "cut_in_map_gap", "overtake_map_gap"]
    asked = study.missions_of(params)
    assert list(asked) == names
    assert [job.mission.name for job in study.jobs_of(params, asked, "idm")[::2]] == names
    for wrong in ({"drivers": ("stack", "pdm")}, {"scenes": ("x",), "traffic": ("replay",)}):
        with pytest.raises(ConfigError, match="nobody but the stack finds its pose"):
            study.missions_of(dataclasses.replace(params, **wrong))


def test_the_preset_of_everything_names_everything():
    values = yaml.safe_load((REPOSITORY / "configs/evaluate/preset/all.yaml").read_text(encoding="utf-8"))
    assert values["missions"] == list(MISSIONS)
    assert sorted(values["drivers"]) == sorted(DRIVERS)
    assert values["traffic"] == list(MANNERS)


def test_missing_and_repeated_drives_are_counted():
    wanted = [tuple(r[name] for name in tables.KEY) for r in ROWS]
    assert tables.coverage(ROWS, wanted)["missing"] == ["-"]
    found = tables.coverage([*ROWS[1:], ROWS[5]], wanted)
    assert (found["expected"], found["found"], found["duplicates"]) == ([32], [31], [1])
    assert "overtake" in found["missing"][0]


def test_the_worst_are_failures_of_every_mission_in_turn():
    chosen = tables.worst(ROWS, "idm", 3)
    assert [r["mission"] for r in chosen] == ["overtake", "cut_in", "overtake"]
    assert tables.worst(ROWS, "stack", 5) == [ROWS[3]]


def test_every_cause_has_words_and_a_column():
    assert Cause.NONE.label == "success"
    assert set(tables.failures(ROWS)) == {*tables.GROUP, *(c.label for c in Cause if c)}


def test_drivers_are_told_apart_and_take_their_own_keys():
    params = EvaluateStudy(drivers=("stack", "idm", "blind", "pdm"))
    params = dataclasses.replace(params, idm=params.idm.replace(margin=0.7))
    assert study.loop_of(params, "stack").driver is None
    assert study.loop_of(params, "idm").driver.margin == 0.7
    assert study.loop_of(params, "blind").driver.stack == params.stack
    params = EvaluateStudy(missions=("cut_in", "overtake"), seeds=3, seed=5)
    jobs = study.jobs_of(params, study.missions_of(params), "idm")
    assert [(job.mission.name, job.seed) for job in jobs] == [
        (name, seed) for name in ("cut_in", "overtake") for seed in (5, 6, 7)
    ]


def test_recordings_are_asked_for_by_their_drivers_or_by_their_problems(tmp_path):
    (tmp_path / "crossing.xml").write_text(texts.COMMONROAD)
    params = EvaluateStudy(missions=(), scenes=("crossing",), folder=str(tmp_path), traffic=("replay",), shortest=0.2)
    for egos, names in (("vehicles", ["100"]), ("problems", ["problem 200"])):
        (one,) = study.missions_of(dataclasses.replace(params, egos=egos)).values()
        assert [start.name for start in one.scene.starts] == names
        assert [job.seed for job in study.jobs_of(params, {"crossing": one}, "replay")] == [0]
        assert recordings.signals([one.scene])["signals by the map's program"] == [1]


def known_run(folder, params, *, parts=(), logs=()):
    """The directory of a run of these params that was cut off, with the rows and the logs of some parts."""
    run = directory.Run(folder, {})
    found = driving.MissionDrives(params, run)
    for name in parts:
        rows = [{**row("idm", "cut_in", job.seed, True, 0.5)} for job in found.batches[0].parts[name]]
        pyarrow.parquet.write_table(pyarrow.table(tables.columns(rows)), run.path("rows") / f"{name}.parquet")
    run.path("logs").mkdir(exist_ok=True)
    for name in logs:
        (run.path("logs") / f"{name}.parquet").write_text("logs")
    return str(run.directory)


def test_what_is_known_of_a_run_is_not_driven_again(tmp_path):
    params = EvaluateStudy(missions=("cut_in",), drivers=("idm",), seeds=40)
    names = [f"idm-idm-cut_in-{k:05d}" for k in range(3)]
    cut = known_run(tmp_path / "cut", params, parts=names[:2])
    found = driving.MissionDrives(dataclasses.replace(params, resume=cut), directory.Run(tmp_path / "rest", {}))
    assert list(found.missing()) == names[2:]
    found.take(names[2], [Outcome(job, row("idm", "cut_in", job.seed, True, 0.5)) for job in range_of(8)], _now)
    rows = found.rows()
    assert [one["seed"] for one in rows] == list(range(40))
    assert sorted(path.stem for path in (tmp_path / "rest" / "rows").glob("*.parquet")) == names


def range_of(count):
    return [Job(MISSIONS["cut_in"], 32 + k) for k in range(count)]


def _now(call):
    call()


def test_a_part_without_its_logs_is_driven_again_where_logs_are_wanted(tmp_path):
    params = EvaluateStudy(missions=("cut_in",), drivers=("idm",), seeds=40)
    names = [f"idm-idm-cut_in-{k:05d}" for k in range(3)]
    cut = known_run(tmp_path / "cut", params, parts=names, logs=names[:1])
    plain, logged = (dataclasses.replace(params, resume=cut, logs=logs) for logs in (False, True))
    assert not driving.MissionDrives(plain, directory.Run(tmp_path / "plain", {})).missing()
    assert list(driving.MissionDrives(logged, directory.Run(tmp_path / "logged", {})).missing()) == names[1:]


def test_processes_share_the_parts_and_none_is_driven_twice(tmp_path):
    params = EvaluateStudy(missions=("cut_in", "overtake"), drivers=("idm",), seeds=40, processes=3)
    shares = [
        list(driving.MissionDrives(dataclasses.replace(params, process=k), directory.Run(tmp_path, {})).missing())
        for k in range(3)
    ]
    assert [len(share) for share in shares] == [2, 2, 2]
    assert len({name for share in shares for name in share}) == 6


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"run": "x"}, "belong together"),
        ({"against": "x"}, "belong together"),
        ({"run": "x", "against": "y"}, r"run=x: there is no rows\.parquet"),
        ({"replay": "x"}, r"replay=x: there is no rows\.parquet"),
    ],
)
def test_what_is_no_run_is_named(changes, message, tmp_path):
    run = directory.Run(tmp_path / "run", {})
    with pytest.raises(ConfigError, match=message):
        report.write(EvaluateStudy(**changes), run)
    with pytest.raises(ConfigError, match="resume"):
        study.known(str(tmp_path / "nothing"), {})


def test_only_a_run_of_the_same_config_and_code_is_gone_on_with(tmp_path):
    (tmp_path / "rows").mkdir()
    stamp = {"config": {"seeds": 3, "stack": {"x": 1.0}}, "config_sha256": "ab", "code": {"commit": "a"}}
    (tmp_path / "rows" / study.STAMP).write_text(json.dumps(stamp))
    assert study.known(str(tmp_path), stamp) == {}
    with pytest.raises(ConfigError, match=r"another stack\.x"):
        study.known(str(tmp_path), {**stamp, "config": {"seeds": 3, "stack": {"x": 2.0}}})
    with pytest.raises(ConfigError, match=r"another value behind a \$"):
        study.known(str(tmp_path), {**stamp, "config_sha256": "f0"})
    with pytest.raises(ConfigError, match="another commit"):
        study.known(str(tmp_path), {**stamp, "code": {"commit": "b"}})


def test_another_driver_than_the_stack_has_no_reasons():
    assert replay.reasons(None) == {}


def test_a_run_is_driven_again_only_in_the_environment_that_it_had(tmp_path, monkeypatch):
    config = {"seeds": "${oc.decode:${oc.env:DRIVES}}"}
    manifest = {"config": config, "config_sha256": directory.digest({"seeds": 3})}
    (tmp_path / "manifest.json").write_text(json.dumps(manifest))
    monkeypatch.setenv("DRIVES", "3")
    assert replay._params_of(str(tmp_path)).seeds == 3
    monkeypatch.setenv("DRIVES", "4")
    with pytest.raises(ConfigError, match="stood for other values"):
        replay._params_of(str(tmp_path))
