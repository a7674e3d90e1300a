"""What a file of logs holds is what was logged, to the bit."""

import re

import numpy as np
import pyarrow.parquet
import pytest

from tests.conftest import REPOSITORY
from urbanjax.evaluation import road_users
from urbanjax.evaluation.batch import Job, Outcome
from urbanjax.evaluation.missions import MISSIONS
from urbanjax.io.runs.background import background
from urbanjax.io.runs.drive_logs import read_log, write_logs
from urbanjax.sim.log import Log
from urbanjax.types import Command, ConfigError, Objects, RoadUser, VehicleState
from urbanjax.vehicle.params import VehicleParams

STEPS, OTHERS, ABSENT = 60, 4, 2
VEHICLE = VehicleParams()


def outcome(seed: int, duration: float, *, kinds: bool = True) -> Outcome:
    """A drive of everybody straight on; number `ABSENT` of the others is never there, the last one at times."""
    rng = np.random.default_rng(seed)
    time = np.float32(1.0) + np.arange(STEPS, dtype=np.float32) * np.float32(0.1)
    speed = np.broadcast_to(rng.uniform(3, 9, OTHERS + 1), (STEPS, OTHERS + 1)).astype(np.float32)
    x = speed * (time - time[0])[:, None] + 15 * np.arange(OTHERS + 1)
    places = np.stack([x, 4.0 * np.ones_like(x)], axis=-1).astype(np.float32)
    valid = rng.uniform(size=(STEPS, OTHERS)) < np.array([1, 1, 1, 0.5])
    valid[:, ABSENT] = False
    zero = np.zeros(STEPS, np.float32)
    others = Objects(
        places[:, 1:],
        np.zeros_like(speed[:, 1:]),
        speed[:, 1:],
        np.full_like(speed[:, 1:], 4.5),
        np.full_like(speed[:, 1:], 1.9),
        valid,
        kind=np.full((STEPS, OTHERS), RoadUser.CYCLIST, np.int32) if kinds else None,
    )
    ego = VehicleState(places[:, 0] - np.float32([1.4, 0]), zero, speed[:, 0], zero, zero)
    log = Log(time, ego, Command(zero, zero), places[:, 0], speed[:, 0], zero, zero, others)
    return Outcome(Job(MISSIONS["cut_in"], seed), {"traffic": "idm", "duration_s": np.float32(duration)}, log)


@pytest.fixture
def run(tmp_path):
    """A run directory with two files of logs."""
    folder = tmp_path / "run" / "logs"
    folder.mkdir(parents=True)
    write_logs(
        folder / "stack-idm-00000.parquet", "stack", outcomes=[outcome(2, 2.0), outcome(3, 4.0)], vehicle=VEHICLE
    )
    write_logs(folder / "stack-idm-00001.parquet", "stack", outcomes=[outcome(4, 9.0, kinds=False)], vehicle=VEHICLE)
    return tmp_path / "run"


@pytest.mark.parametrize(("seed", "duration", "kinds"), [(2, 2.0, True), (3, 4.0, True), (4, 9.0, False)])
def test_a_file_equals_the_log_until_the_drive_ends(run, seed, duration, kinds):
    log = outcome(seed, duration, kinds=kinds).log
    steps = min(round(10 * duration) + 1, STEPS)
    drive = read_log(run, "stack", mission="cut_in", seed=seed)
    present = [k for k in range(OTHERS) if k != ABSENT]
    np.testing.assert_array_equal(drive.number, [0, *(k + 1 for k in present)])
    np.testing.assert_array_equal(drive.time, log.time[:steps])
    them = drive.objects
    np.testing.assert_array_equal(them.position[:, 0], log.centre[:steps])
    np.testing.assert_array_equal(them.heading[:, 0], log.ego.heading[:steps])
    np.testing.assert_array_equal(them.speed[:, 0], log.ego.speed[:steps])
    assert them.valid[:, 0].all()
    assert np.all(them.length[:, 0] == np.float32(VEHICLE.length))
    assert np.all(them.kind[:, 1:] == (RoadUser.CYCLIST if kinds else RoadUser.VEHICLE))
    for name in ("position", "heading", "speed", "length", "width", "valid"):
        ours, theirs = getattr(them, name)[:, 1:], getattr(log.traffic, name)[:steps][:, present]
        assert ours.dtype == theirs.dtype
        np.testing.assert_array_equal(ours, theirs, err_msg=name)


def test_a_drive_is_a_row_group_and_floats_are_single(run):
    file = pyarrow.parquet.ParquetFile(run / "logs" / "stack-idm-00000.parquet")
    assert file.num_row_groups == 2
    assert file.schema_arrow.field("x").type == pyarrow.float32()
    assert file.metadata.row_group(0).column(6).compression == "ZSTD"
    assert not list((run / "logs").glob("*.part"))


@pytest.mark.parametrize("asked", [{"driver": "idm"}, {"mission": "overtake"}, {"seed": 9}, {"traffic": "mixed"}])
def test_a_drive_that_is_not_there_is_named(run, asked):
    asked = {"driver": "stack", "mission": "cut_in", "seed": 2, **asked}
    with pytest.raises(ConfigError, match="has no"):
        read_log(run, asked.pop("driver"), **asked)
    with pytest.raises(ConfigError, match="no log"):
        road_users.until_end(Outcome(Job(MISSIONS["cut_in"], 0), {"duration_s": 1.0}))


def test_the_example_of_the_docs_runs_as_printed(run, monkeypatch, capsys):
    (example,) = re.findall(r"```python\n(.*?)```", (REPOSITORY / "docs/evaluation.md").read_text(), re.DOTALL)
    monkeypatch.chdir(run.parent)
    exec(compile(example, "docs/evaluation.md", "exec"), {})
    assert "least time to collision" in capsys.readouterr().out


def test_what_fails_in_the_background_is_raised():
    found = []
    with background() as later:
        for k in range(20):
            later(lambda k=k: found.append(k))
    assert found == list(range(20))
    with pytest.raises(ZeroDivisionError), background() as later:
        later(lambda: 1 / 0)
