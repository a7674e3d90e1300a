"""The command that evaluates, in a process of its own."""

import os
import subprocess
import sys

from tests.conftest import REPOSITORY


def evaluate(folder, *arguments, devices=1):
    """The process, begun, that evaluates into a folder with the smallest settings and what is asked besides."""
    command = [sys.executable, "-m", "experiments.evaluate", "preset=smoke", "worst=0", *arguments]
    environment = {**os.environ, "JAX_PLATFORMS": "cpu", "PYTHONPATH": str(REPOSITORY)}
    environment |= {"XLA_FLAGS": f"--xla_force_host_platform_device_count={devices}"}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    return subprocess.Popen([*command, f"hydra.run.dir={folder}"], cwd=folder.parent, env=environment, **pipes)


def tables(folder):
    """The files of a run that hold what came out, by name: bytes."""
    names = ["rows.csv", "headline.csv", "missions.csv", "causes.csv", "nuplan.csv", "coverage.csv"]
    files = [folder / name for name in names] + sorted((folder / "logs").glob("*"))
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}
