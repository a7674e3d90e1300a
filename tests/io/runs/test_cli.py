"""The command line as a user types it: one line for a mistake, every value shown, presets from files."""

import json
import subprocess
import sys

import pytest

from tests.conftest import REPOSITORY

PROGRAM = """
from typing import ClassVar
from urbanjax.io.runs import cli
from urbanjax.types import ScenarioError, Unread, pytree, static
from urbanjax.vehicle.params import VehicleParams


@pytree
class Toy:
    UNREAD: ClassVar = {"vehicle.max_speed": Unread("nobody drives, see 'grid'")}
    vehicle: VehicleParams = VehicleParams()
    grid: tuple[float, ...] = (0.0, 1.0)
    seed: int = static(default=0)
    fail: bool = static(default=False)


@cli.experiment("toy", Toy)
def main(params, run):
    run.summary({"length_m": params.vehicle.length, "ttc_s": float("inf")})
    if params.fail:
        raise ScenarioError("the scene\\nis empty")


if __name__ == "__main__":
    main()
"""


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    root = tmp_path_factory.mktemp("toy")
    (root / "programs" / "toy").mkdir(parents=True)
    (root / "programs" / "toy" / "__main__.py").write_text(PROGRAM)
    presets = root / "configs" / "toy" / "preset"
    presets.mkdir(parents=True)
    (presets / "fast.yaml").write_text("# @package _global_\nvehicle:\n  max_speed: 50\n")
    (presets / "short.yaml").write_text("# @package _global_\nvehicle:\n  length: 3\n")
    (presets / "wrong.yaml").write_text("# @package _global_\nvehicle:\n  lenght: 3\n")
    return root


# Imports once what takes long to import, then runs the program in a fork of itself for every line of arguments.
SERVER = """
import json, os, runpy, sys, traceback
import hydra, omegaconf, urbanjax.io.runs.cli
for line in sys.stdin:
    arguments = json.loads(line)
    child = os.fork()
    if not child:
        for number, name in ((1, "stdout"), (2, "stderr")):
            os.dup2(os.open(name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
        sys.argv, code = ["toy", *arguments], 0
        try:
            runpy.run_module("programs.toy", run_name="__main__", alter_sys=True)
        except SystemExit as end:
            code = end.code or 0
        except BaseException:
            traceback.print_exc()
            code = 1
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


@pytest.fixture(scope="module")
def server(home):
    environment = {"PYTHONPATH": f"{home}:{REPOSITORY}", "JAX_PLATFORMS": "cpu", "PATH": "/usr/bin:/bin"}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, "-c", SERVER], cwd=home, env=environment, **pipes) as process:
        yield process
        process.stdin.close()


@pytest.fixture
def run(home, server):
    """The program as typed: its exit code, and what it prints."""

    def program(*arguments):
        server.stdin.write(json.dumps(arguments) + "\n")
        server.stdin.flush()
        code = int(server.stdout.readline())
        return subprocess.CompletedProcess(arguments, code, *((home / x).read_text() for x in ("stdout", "stderr")))

    return program


def test_cfg_job_shows_every_value(home, run):
    done = run("--cfg", "job")
    assert done.returncode == 0, done.stderr
    assert "wheelbase: 2.8" in done.stdout
    assert "seed: 0" in done.stdout


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
        ("preset=wrong", "unknown key 'vehicle.lenght' in configs/toy/preset/wrong.yaml; the nearest"),
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
    [["vehicle.max_speed=50"], ["vehicle.max_speed=40.0"], ["-m", "vehicle.max_speed=40,50"], ["preset=fast"]],
    ids=["changed", "as it is", "swept", "preset"],
)
def test_a_value_that_nothing_reads_ends_the_program(home, run, arguments):
    done = run(*arguments, "hydra.run.dir=outputs/unread")
    assert done.returncode == 2
    assert done.stderr == "error: 'vehicle.max_speed' is read by nothing here: nobody drives, see 'grid'\n"
    assert not (home / "outputs/unread").exists()
