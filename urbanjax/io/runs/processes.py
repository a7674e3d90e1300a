"""One run of several processes, of one machine or of several that share a disk: the first one writes what they find."""

import contextlib
import hashlib
import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from urbanjax.io.runs import directory
from urbanjax.io.runs.directory import Run, write_atomically
from urbanjax.types import ConfigError, UrbanJaxError

KEYS = ("coordinator", "process", "processes")  # of the config of an experiment that can be shared
OWN = (*KEYS, "resume")  # what may differ between processes
LONGEST = 4096  # bytes of a message
PAUSE = 0.2  # s between two looks at the disk


def shared(config: Mapping[str, Any]) -> bool:
    """Whether several processes share a run. Args: config, of it."""
    return config.get("processes", 1) > 1


def follows(config: Mapping[str, Any]) -> bool:
    """Whether this is not the first process, which writes what all have found. Args: config, of the run."""
    return config.get("process", 0) > 0


def recorder(values: Mapping[str, Any]) -> Callable:
    """What makes the `Run` of a config: `directory.record`, or the same with the directory of process 0.

    Where there are several processes JAX is told so, before it touches a device. Args: values, of the config. Raises
    ConfigError for keys that do not belong together.
    """
    coordinator, process, processes = (
        values.get("coordinator", ""),
        values.get("process", 0),
        values.get("processes", 1),
    )
    if not coordinator and (process or processes > 1):
        raise ConfigError("'process' and 'processes' need 'coordinator', the HOST:PORT of process 0 for all of them")
    if not coordinator:
        return directory.record
    host, _, port = coordinator.rpartition(":")
    if not host or not port.isdigit():
        raise ConfigError(f"coordinator={coordinator}: give HOST:PORT of process 0, such as 127.0.0.1:12345")
    if process >= processes:
        raise ConfigError(f"process={process}: they are numbered from 0 to processes - 1, which is {processes - 1}")
    import jax

    try:
        jax.distributed.initialize(coordinator, processes, process)
    except RuntimeError as error:
        raise ConfigError(f"coordinator={coordinator}: no connection ({str(error).splitlines()[0]})") from error
    return _other if process else _first


@contextlib.contextmanager
def _first(folder: Path, values: Mapping[str, Any], *, seed: int | None = None) -> Iterator[Run]:
    with directory.record(folder, values, seed=seed) as run:
        _tell(f"{_digest(values)} {run.directory.resolve()}")
        yield run


@contextlib.contextmanager
def _other(folder: Path, values: Mapping[str, Any], *, seed: int | None = None) -> Iterator[Run]:
    """The run of process 0, until that has ended it: a process that leaves early is taken for a failed one."""
    digest, _, told = _tell("").partition(" ")
    theirs, process = Path(told), values["process"]
    if folder.resolve() != theirs:
        with contextlib.suppress(OSError):
            folder.rmdir()  # nothing is written there
    run = Run(theirs, values, seed)
    if run.directory != theirs:
        raise UrbanJaxError(f"process 0 has ended its run before process {process} began: see {theirs}")
    try:
        if digest != _digest(values):
            raise ConfigError(f"process={process}: its config or its code is not that of process 0")
        yield run
    except BaseException as error:
        write_atomically(_failure(run, process), f"{type(error).__name__}: {error}")
        raise
    print(f"process {process} is done; run directory: {theirs}", flush=True)
    while not run.path("manifest.json").exists():
        time.sleep(PAUSE)


def wait_for(files: Sequence[Path], run: Run, *, tick: Callable[[int], None] = lambda count: None) -> None:
    """Wait until all files of a run are there.

    Args: files, that other processes write; run, to which they belong; tick, told how many are missing. Raises
    UrbanJaxError where one of the processes has failed.
    """
    missing = list(files)
    while missing := [path for path in missing if not path.exists()]:
        for process in range(1, run.config["processes"]):
            if _failure(run, process).exists():
                raise UrbanJaxError(f"process {process} has failed: {_failure(run, process).read_text('utf-8')}")
        tick(len(missing))
        time.sleep(PAUSE)


def _failure(run: Run, process: int) -> Path:
    return run.path(f"process_{process}_failed.txt")


def _digest(values: Mapping[str, Any]) -> str:
    """Of what must be the same in all processes."""
    same = {name: value for name, value in values.items() if name not in OWN}
    return hashlib.sha256(json.dumps([same, directory.git_state()], sort_keys=True).encode()).hexdigest()


def _tell(text: str) -> str:
    """What process 0 says, in all processes; all call it at the same time."""
    from jax.experimental import multihost_utils

    said = text.encode()
    if len(said) > LONGEST:
        raise ConfigError(f"the path of the run directory is longer than {LONGEST} bytes: give a shorter hydra.run.dir")
    sent = np.zeros(LONGEST, np.uint8)
    sent[: len(said)] = np.frombuffer(said, np.uint8)
    return bytes(np.asarray(multihost_utils.broadcast_one_to_all(sent))).rstrip(b"\0").decode()
