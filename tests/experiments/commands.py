"""The command that evaluates, in a process of its own."""

import atexit
import os
import shutil
import subprocess
import sys
import tempfile

from tests.conftest import REPOSITORY

# Programs that one test compiles serve the others of this process, and nothing of the user's own is touched.
CACHE = tempfile.mkdtemp(prefix="urbanjax-tests-")
atexit.register(shutil.rmtree, CACHE, ignore_errors=True)


def evaluate(folder, *arguments, devices=1):
    """The process, begun, that evaluates into a folder with the smallest settings and what is asked besides."""
    command = [sys.executable, "-m", "experiments.evaluate", "preset=smoke", "worst=0", *arguments]
    environment = {**os.environ, "JAX_PLATFORMS": "cpu", "PYTHONPATH": str(REPOSITORY)}
    environment |= {"XLA_FLAGS": f"--xla_force_host_platform_device_count={devices}"}
    environment |= {"JAX_COMPILATION_CACHE_DIR": CACHE, "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0"}
    environment |= {"JAX_ENABLE_COMPILATION_CACHE": "true"}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    return subprocess.Popen([*command, f"hydra.run.dir={folder}"], cwd=folder.parent, env=environment, **pipes)


def tables(folder):
    """The files of a run that hold what came out, by name: bytes."""
    names = ["rows.csv", "headline.csv", "missions.csv", "causes.csv", "nuplan.csv", "coverage.csv"]
    files = [folder / name for name in names] + sorted((folder / "logs").glob("*"))
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}
