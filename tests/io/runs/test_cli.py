"""The command line as a user types it: one line for a mistake, every value shown, presets from files."""

import json

import pytest


def test_cfg_job_shows_every_value(home, run):
    done = run("--cfg", "job")
    assert done.returncode == 0, done.stderr
    assert "wheelbase: 2.8" in done.stdout
    assert "seed: 0" in done.stdout


def test_cfg_job_is_a_preset_that_changes_nothing(home, run):
    shown = run("--cfg", "job").stdout
    assert shown.startswith("# @package _global_\n")
    assert "grid: [0.0, 1.0]" in shown.splitlines()
    assert shown.index("seed: ") < shown.index("vehicle:")
    (home / "shown/preset").mkdir(parents=True)
    (home / "shown/preset/same.yaml").write_text(shown)
    assert run("--config-dir=shown", "preset=same", "--cfg", "job").stdout == shown
    assert run("--cfg", "job", "--package", "vehicle").stdout.startswith("# @package vehicle\n")


def test_help_says_what_there_is_to_choose(run):
    done = run("--help")
    assert done.returncode == 0, done.stderr
    for text in (
        "python -m programs.toy [preset=NAME]",
        "preset=short  Short cars.",
        "seed    0",
        "  vehicle",
        "-m KEY",
    ):
        assert text in done.stdout
    assert "ydra (" not in done.stdout
    assert "Powered" not in done.stdout


def test_a_run_ends_with_its_directory_and_manifest(home, run):
    done = run("preset=short", "hydra.run.dir=outputs/one")
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "run directory: outputs/one"
    manifest = json.loads((home / "outputs/one/manifest.json").read_text())
    assert manifest["status"] == "complete"
    assert manifest["seed"] == 0
    assert manifest["config"]["vehicle"]["length"] == 3
    assert json.loads((home / "outputs/one/summary.json").read_text()) == {"length_m": 3.0, "ttc_s": None}


@pytest.mark.parametrize(
    ("argument", "message"),
    [
        (
            "vehcle.lenght=1",
            "unknown key 'vehcle.lenght' on the command line; the nearest valid key is 'vehicle.length'",
        ),
        ("+vehicle.lenght=1", "unknown key 'vehicle.lenght'; the nearest valid key is 'vehicle.length'"),
        (
            "preset=wrong",
            "unknown key 'vehicle.lenght' in configs/toy/preset/wrong.yaml, line 3, column 3; the nearest",
        ),
        ("+vehicle._target_=os.system", "'vehicle._target_' is refused"),
        ("vehicle.length=nan", "must be a finite number, not nan"),
        ("seed=-1", "'seed' must be at least 0"),
        ("grid=[]", "must not be empty"),
        ("grid=[1", "no viable alternative"),
        ("grid", "cannot read 'grid' on the command line: write KEY=VALUE such as 'grid=VALUE'"),
        ("vehicle=[99]", "'vehicle' is a group of values, not [99]: set one of vehicle."),
        ("preset=zzz", "there is no preset 'zzz': use one of fast, short, wrong"),
        ("seed=99999999999999999999999", "'seed' must be at most 9007199254740992"),
        ("fail=true", "the scene is empty"),
    ],
)
def test_a_mistake_is_one_line_and_exit_code_two(home, run, argument, message):
    done = run(argument)
    assert done.returncode == 2
    assert done.stderr.startswith("error: ")
    assert message in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    "arguments",
    [
        ["vehicle.max_speed=50"],
        ["vehicle.max_speed=40.0"],
        ["-m", "vehicle.max_speed=40,50"],
        ["preset=fast"],
    ],
    ids=["changed", "as it is", "swept", "preset"],
)
def test_a_value_that_nothing_reads_ends_the_program(home, run, arguments):
    done = run(*arguments, "hydra.run.dir=outputs/unread")
    assert done.returncode == 2
    place = " (configs/toy/preset/fast.yaml, line 3, column 3)" if "preset=fast" in arguments else ""
    assert done.stderr == f"error: 'vehicle.max_speed' is read by nothing here: nobody drives, see 'grid'{place}\n"
    assert not (home / "outputs/unread").exists()
