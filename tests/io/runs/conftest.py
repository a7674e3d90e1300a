"""A small experiment as a user starts it, from a fork of a process that has imported everything."""

import json
import subprocess
import sys

import pytest

from tests.conftest import REPOSITORY

PROGRAM = """
import os
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
    folder: str = static(default="", metadata={"path": True})


@cli.experiment("toy", Toy, anew="TOY_ANEW" in os.environ)
def main(params, run):
    if params.folder == "compile":
        import jax

        print("answer:", float(jax.jit(lambda x: x * 2 + 1)(20.5)))
    if params.folder.startswith("/secret"):
        raise ScenarioError(f"{params.folder}/x is not there")
    run.summary({"length_m": params.vehicle.length, "ttc_s": float("inf")})
    if params.fail:
        raise ScenarioError("the scene\\nis empty")


if __name__ == "__main__":
    main()
"""


@pytest.fixture(scope="session")
def home(tmp_path_factory):
    root = tmp_path_factory.mktemp("toy")
    (root / "programs" / "toy").mkdir(parents=True)
    (root / "programs" / "toy" / "__main__.py").write_text(PROGRAM)
    presets = root / "configs" / "toy" / "preset"
    presets.mkdir(parents=True)
    (presets / "fast.yaml").write_text("# @package _global_\nvehicle:\n  max_speed: 50\n")
    (presets / "short.yaml").write_text("# @package _global_\n# Short cars.\nvehicle:\n  length: 3\n")
    (presets / "wrong.yaml").write_text("# @package _global_\nvehicle:\n  lenght: 3\n")
    return root


# Imports once what takes long to import, then runs the program in a fork of itself for every line of arguments.
SERVER = """
import json, os, runpy, sys, traceback
import hydra, omegaconf, urbanjax.io.runs.cli
for line in sys.stdin:
    arguments, environment = json.loads(line)
    child = os.fork()
    if not child:
        os.environ.update(environment)
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


@pytest.fixture(scope="session")
def server(home):
    environment = {"PYTHONPATH": f"{home}:{REPOSITORY}", "JAX_PLATFORMS": "cpu", "PATH": "/usr/bin:/bin"}
    environment["XDG_CACHE_HOME"] = str(home / "cache")
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, "-c", SERVER], cwd=home, env=environment, **pipes) as process:
        yield process
        process.stdin.close()


@pytest.fixture
def run(home, server):
    """The program as typed: its exit code, and what it prints."""

    def program(*arguments, **environment):
        server.stdin.write(json.dumps([arguments, environment]) + "\n")
        server.stdin.flush()
        code = int(server.stdout.readline())
        return subprocess.CompletedProcess(arguments, code, *((home / x).read_text() for x in ("stdout", "stderr")))

    return program
