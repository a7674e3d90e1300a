"""Several processes that share a run, and what is said where they do not fit together."""

import socket

import pytest

from tests.experiments.commands import evaluate, tables
from urbanjax.io.runs import directory, processes
from urbanjax.types import ConfigError, UrbanJaxError


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


def test_the_first_process_waits_until_all_is_there_or_one_has_failed(tmp_path):
    run = directory.Run(tmp_path, {"processes": 2})
    files = [run.path(name) for name in ("one", "two")]
    files[0].touch()
    counts = []

    def tick(count):
        counts.append(count)
        files[1].touch()

    processes.wait_for(files, run, tick=tick)
    assert counts == [1]
    processes._failure(run, 1).write_text("ConfigError: why")
    processes.wait_for(files, run)
    with pytest.raises(UrbanJaxError, match="process 1 has failed: ConfigError: why"):
        processes.wait_for([run.path("three")], run)


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
    assert "process 1 has failed: ConfigError" in said[0]
    assert "is not that of process 0" in said[1]
