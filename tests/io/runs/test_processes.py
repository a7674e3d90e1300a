"""Several processes that share a run, and what is said where they do not fit together."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time

import pytest

from tests.conftest import REPOSITORY
from tests.experiments.commands import evaluate, tables
from urbanjax.io.runs import directory, processes
from urbanjax.types import ConfigError

LIMIT = 120.0  # s


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def test_one_process_needs_nothing():
    assert processes.recorder({}) is directory.record
    assert processes.recorder({"coordinator": "", "process": 0, "processes": 1}) is directory.record


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"coordinator": "", "process": 1, "processes": 2}, "need 'coordinator'"),
        ({"coordinator": "", "process": 0, "processes": 2}, "need 'coordinator'"),
        ({"coordinator": "127.0.0.1", "process": 0, "processes": 2}, "give HOST:PORT"),
        ({"coordinator": "127.0.0.1:x", "process": 0, "processes": 2}, "give HOST:PORT"),
        ({"coordinator": "127.0.0.1:1", "process": 2, "processes": 2}, "processes - 1, which is 1"),
    ],
)
def test_keys_that_do_not_belong_together_are_refused(values, message):
    with pytest.raises(ConfigError, match=message):
        processes.recorder(values)


def test_those_that_belong_together_say_whether_the_run_is_shared():
    assert processes.shared({"coordinator": "127.0.0.1:1", "process": 1, "processes": 2})
    assert not processes.shared({"coordinator": "127.0.0.1:1", "process": 0, "processes": 1})


def test_files_of_others_are_waited_for(tmp_path):
    run = directory.Run(tmp_path, {"processes": 2})
    files = [run.path(name) for name in ("one", "two")]
    files[0].touch()
    counts = []

    def tick(count):
        counts.append(count)
        files[1].touch()

    processes.wait_for(files, run, tick=tick)
    processes.wait_for(files, run, tick=tick)
    assert counts == [1]


SHARE = """
import sys, time
from pathlib import Path
from urbanjax.io.runs import processes
from urbanjax.types import UrbanJaxError

processes.PATIENCE = 60.0
coordinator, process, count, last = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), sys.argv[4]
values = {"coordinator": coordinator, "process": process, "processes": count}
try:
    with processes.recorder(values)(Path(f"of_{process}"), values) as run:
        import jax

        run.path(f"devices_{process}").write_text(f"{jax.process_index()} {jax.device_count()} {jax.jit(abs)(-2)}")
        processes.wait_for([run.path(f"devices_{k}") for k in range(count)] + [run.path(last)], run)
except UrbanJaxError as error:
    sys.exit(f"error: {error}")
"""


def share(folder, count, *, last):
    """Processes that share a run in a folder, begun, and end when there is a last file."""
    coordinator = f"127.0.0.1:{free_port()}"
    environment = {**os.environ, "JAX_PLATFORMS": "cpu", "PYTHONPATH": str(REPOSITORY)}
    environment |= {"XLA_FLAGS": "--xla_force_host_platform_device_count=2"}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "cwd": folder, "env": environment}
    commands = [[sys.executable, "-c", SHARE, coordinator, str(k), str(count), last] for k in range(count)]
    return [subprocess.Popen(command, **pipes) for command in commands]


def test_all_know_the_devices_of_all_and_one_directory(tmp_path):
    pair = share(tmp_path, 2, last="devices_0")
    said = [one.communicate(timeout=LIMIT) for one in pair]
    assert [one.returncode for one in pair] == [0, 0], said
    assert [err for _, err in said] == ["", ""]
    assert [(tmp_path / "of_0" / f"devices_{k}").read_text() for k in range(2)] == ["0 4 2", "1 4 2"]
    assert json.loads((tmp_path / "of_0" / "manifest.json").read_text())["status"] == "complete"
    assert not (tmp_path / "of_1").exists()


@pytest.mark.parametrize(
    ("count", "ended", "number"),
    [
        (2, 0, signal.SIGKILL),
        *[pytest.param(n, k, signal.SIGKILL, marks=pytest.mark.slow) for n, k in ((2, 1), (3, 0), (3, 2))],
        *[pytest.param(2, k, signal.SIGTERM, marks=pytest.mark.slow) for k in (0, 1)],
        *[pytest.param(2, k, signal.SIGINT, marks=pytest.mark.slow) for k in (0, 1)],
    ],
)
def test_where_one_process_is_ended_all_end_with_one_line(tmp_path, count, ended, number):
    group = share(tmp_path, count, last="never")
    files, began = [tmp_path / "of_0" / f"devices_{k}" for k in range(count)], time.monotonic()
    while not all(file.exists() for file in files) and time.monotonic() - began < LIMIT:
        time.sleep(0.05)
    group[ended].send_signal(number)
    said = [one.communicate(timeout=LIMIT)[1] for one in group]
    why = "ended without a word" if number == signal.SIGKILL else f"told to end ({number.name})"
    line = rf"error: process {ended} (has|was) {re.escape(why)}: what has been computed is kept in of_0; "
    for process, one in enumerate(group):
        if process == ended and number == signal.SIGKILL:
            assert (one.returncode, said[process]) == (-number, "")
        else:
            assert re.fullmatch(line + "start all processes again with resume=of_0\n", said[process]), said
            assert one.returncode == 1


@pytest.mark.slow
def test_two_processes_come_to_what_one_comes_to(tmp_path):
    """Three chunks, the last one not full; and a second process of another config ends both."""
    drives = ("seeds=40", "logs=true")
    alone = evaluate(tmp_path / "alone", *drives)
    said = alone.communicate(timeout=600)[0]
    assert alone.returncode == 0, said

    def together(name, *, seed):
        shared = (f"coordinator=127.0.0.1:{free_port()}", "processes=2")
        pair = [
            evaluate(tmp_path / f"{name}{k}", *drives, *shared, f"process={k}", f"seed={seed * k}") for k in range(2)
        ]
        said = [one.communicate(timeout=600)[0] for one in pair]
        return [one.returncode for one in pair], said

    codes, said = together("both", seed=0)
    assert codes == [0, 0], said
    assert tables(tmp_path / "both0") == tables(tmp_path / "alone")
    assert len(tables(tmp_path / "alone")) == 9
    assert not (tmp_path / "both1").exists()

    codes, said = together("apart", seed=1)
    assert codes == [2, 2], said
    assert "process 1 has another config.seed than process 0" in said[0]
    assert "is not that of process 0, see config.seed" in said[1]
    assert not (tmp_path / "apart0").exists()
