"""Sweeps as a user types them: what is done stays done, what fails is listed, and the same command goes on."""

import csv
import fcntl
import json
import subprocess
import time

import pytest

from urbanjax.io.runs.parameter_file import write_parameters

COMMAND = ("-m", "vehicle.length=-0.5,linspace:0.5:2.5:5", "seed=1,2", "hydra.sweep.dir=outputs/sweeps")


def rows_of(folder):
    with open(folder / "table.csv", newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def times(folder):
    return {path.parent.name: path.stat().st_mtime_ns for path in folder.glob("*/manifest.json")}


def sweep_of(home, done):
    """The directory that a sweep says that it is in."""
    return home / done.stdout.partition(", in ")[2].splitlines()[0]


@pytest.fixture(scope="module")
def swept(home, server):
    """A sweep of twelve jobs of which two raise: its directory, and what it said."""
    server.stdin.write(json.dumps([COMMAND, {}]) + "\n")
    server.stdin.flush()
    code = int(server.stdout.readline())
    done = subprocess.CompletedProcess(COMMAND, code, *((home / x).read_text() for x in ("stdout", "stderr")))
    return sweep_of(home, done), done


def test_one_job_that_raises_is_listed_and_ends_no_other(swept):
    folder, done = swept
    assert done.returncode == 2
    assert "of 12 jobs 2 failed (00000, 00001)" in done.stderr
    assert "Traceback" not in done.stderr
    rows = rows_of(folder)
    assert [row["status"] for row in rows] == ["failed"] * 2 + ["complete"] * 10
    assert {row["error"] for row in rows[:2]} == {"ConfigError: 'vehicle.length' must be positive, not -0.5"}
    assert [float(row["length_m"]) for row in rows[2:]] == [x for x in (0.5, 1.0, 1.5, 2.0, 2.5) for _ in range(2)]
    assert [int(row["seed"]) for row in rows] == [1, 2] * 6
    manifest = json.loads((folder / "00003" / "manifest.json").read_text())
    assert manifest["overrides"] == {"vehicle.length": 0.5, "seed": 2}
    assert manifest["config"]["vehicle"]["length"] == 0.5
    assert (manifest["sweep"], manifest["job"], manifest["seed"]) == (folder.name, "00003", 2)
    assert manifest["summary"] == {"length_m": 0.5, "ttc_s": None}


def test_the_same_command_does_only_what_is_left(home, run, swept):
    folder, _ = swept
    (folder / "00004" / "manifest.json").unlink()
    before = times(folder)
    done = run(*COMMAND)
    after = times(folder)
    assert sweep_of(home, done) == folder
    assert "12 jobs, 9 of them done before" in done.stdout
    assert {name for name in after if after[name] != before.get(name)} == {"00000", "00001", "00004"}
    assert [row["status"] for row in rows_of(folder)] == ["failed"] * 2 + ["complete"] * 10


def test_the_name_of_a_sweep_is_its_content(home, run):
    def name(*arguments, **environment):
        done = run("-m", *arguments, "hydra.sweep.dir=outputs/named", **environment)
        assert done.returncode == 0, done.stderr
        return sweep_of(home, done).name

    first = name("seed=1,2")
    assert name("seed=1,2") == first
    assert name("seed=1,2", "hydra/launcher=joblib") == first
    assert name("seed=1,2", "fail=false") == first
    assert name("seed=1,3") != first
    assert name("seed=1,2", "vehicle.length=3") != first
    presets = home / "configs" / "toy" / "preset"
    (presets / "long.yaml").write_text("# @package _global_\nvehicle:\n  length: 6\n")
    long = name("seed=1", "preset=short,long")
    (presets / "long.yaml").write_text("# @package _global_\nvehicle:\n  length: 7\n")
    assert name("seed=1", "preset=short,long") != long
    (presets / "long.yaml").unlink()
    (home / "scenes").mkdir()
    read = name("seed=1,2", "folder=scenes")
    (home / "scenes" / "one.xml").write_text("<scene/>")
    assert name("seed=1,2", "folder=scenes") != read
    seeded = name("vehicle.length=sobol:1:2:4", "hydra.sweeper.seed=1")
    assert name("vehicle.length=sobol:1:2:4", "hydra.sweeper.seed=2") != seeded


def test_jobs_of_two_sweeps_are_the_same_where_they_compute_the_same(home, run):
    def contents(*arguments, **environment):
        done = run("-m", *arguments, "hydra.sweep.dir=outputs/same", **environment)
        assert done.returncode == 0, done.stderr
        plan = json.loads((sweep_of(home, done) / "sweep.json").read_text())
        return [job["content"] for job in plan["jobs"]]

    one, two = contents("seed=1,2", "vehicle.length=3")
    assert contents("vehicle.length=2,3", "seed=2")[1] == two != one
    tall = home / "configs" / "toy" / "preset" / "tall.yaml"
    tall.write_text("# @package _global_\nvehicle:\n  length: 3\n  width: 1.7\n")
    assert contents("seed=2", "preset=tall,short")[1] == two
    tall.unlink()
    there, here = contents("seed=2,3", "folder=there")[0], "folder=${oc.env:SCENES}"
    assert contents("seed=2,3", here, SCENES="there")[0] == there != contents("seed=2,3", here, SCENES="here")[0]


def test_a_sweep_that_another_process_is_at_is_left_alone(home, run, swept):
    folder, _ = swept
    with open(folder / ".lock", "a") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        done = run(*COMMAND)
    assert done.returncode == 2
    assert "another process is at this sweep" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["seed=1,2", "hydra/launcher=vmap"], "'toy' evaluates no drives"),
        (["seed=1,2", "hydra.sweep.dir=stdout"], "stdout"),
        (["vehicle.lenght=1,2"], "unknown key 'vehicle.lenght' on the command line; the nearest"),
        (["vehicle.length=linspace:1:2"], "write KIND:LOW:HIGH:N"),
        (["vehicle.length=interval(0,1)"], "linspace:LOW:HIGH:N"),
        (["vehicle.max_speed=40,50"], "is read by nothing here"),
    ],
)
def test_a_sweep_that_cannot_be_is_one_line(run, arguments, message):
    done = run("-m", *arguments)
    assert done.returncode == 2
    assert message in done.stderr
    assert done.stderr.count("\n") == 1


def test_several_values_without_a_sweep_are_told(run):
    done = run("vehicle.length=linspace:1:2:3")
    assert done.returncode == 2
    assert "add -m" in done.stderr


def test_a_parameter_file_stands_above_a_preset_and_below_what_is_typed(home, run):
    file = home / "mine.yaml"
    write_parameters(file, {"vehicle.length": 0.1 + 0.2, "vehicle.width": 1.5}, about={"job": "00000"})
    done = run("params=mine.yaml", "vehicle.width=1.75", "preset=short", "hydra.run.dir=outputs/back")
    assert done.returncode == 0, done.stderr
    manifest = json.loads((home / "outputs/back/manifest.json").read_text())
    assert manifest["config"]["vehicle"]["length"] == 0.1 + 0.2  # above the preset
    assert manifest["config"]["vehicle"]["width"] == 1.75  # below what is typed
    write_parameters(file, {"vehicle.lenght": 1.0}, about={})
    done = run("params=mine.yaml")
    assert done.returncode == 2
    assert "unknown key 'vehicle.lenght' in mine.yaml; the nearest valid key is 'vehicle.length'" in done.stderr
    file.write_text(file.read_text().replace("urbanjax: 0.1.0", "urbanjax: 9.9.9"))
    done = run("params=mine.yaml")
    assert "mine.yaml: is of urbanjax 9.9.9" in done.stderr


@pytest.mark.slow
def test_joblib_and_submitit_come_to_the_same_table(home, run):
    tables = []
    for launcher in ("basic", "joblib", "submitit_local"):
        began = time.monotonic()
        done = run("-m", "seed=range(6)", f"hydra.sweep.dir=outputs/{launcher}", f"hydra/launcher={launcher}")
        assert done.returncode == 0, (done.stderr, time.monotonic() - began)
        tables.append((sweep_of(home, done) / "table.csv").read_bytes())
    assert tables[0] == tables[1] == tables[2]
