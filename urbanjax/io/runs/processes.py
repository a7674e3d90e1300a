"""One run of several processes, of one machine or of several that share a disk: the first one writes what they find."""

import contextlib
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from urbanjax.io.runs import directory, meeting
from urbanjax.io.runs.directory import Run
from urbanjax.io.runs.line import LIMIT, ProcessLine
from urbanjax.types import ConfigError, UrbanJaxError

Values = Mapping[str, Any]
KEYS = ("coordinator", "process", "processes")  # of the config of an experiment that can be shared
OWN = (*KEYS, "resume")  # what changes nothing in what is computed, and may differ between processes
FAILURES = "failed_in_process_*.txt"
PATIENCE = 300.0  # s in which all processes come
PAUSE = 0.2  # s between two looks at the disk


def shared(config: Mapping[str, Any]) -> bool:
    """Whether several processes share a run.

    Args: config, of it. Raises ConfigError for keys that do not belong together.
    """
    coordinator, process, processes = _keys(config)
    if not coordinator and (process or processes > 1):
        raise ConfigError("'process' and 'processes' need 'coordinator', the HOST:PORT of process 0 for all of them")
    if not coordinator:
        return False
    meeting.address(coordinator)
    if process >= processes:
        raise ConfigError(f"process={process}: they are numbered from 0 to processes - 1, which is {processes - 1}")
    return processes > 1


def follows(config: Mapping[str, Any]) -> bool:
    """Whether this is not the first process, which writes what all have found. Args: config, of the run."""
    return _keys(config)[1] > 0


def tell_failure(run: Run, error: Exception) -> None:
    """Say in the directory of a run why this process has nothing of its share. Args: run; error, that it raised."""
    path = run.path(FAILURES.replace("*", str(_keys(run.resolved)[1])))
    directory.write_atomically(path, f"{type(error).__name__}: {' '.join(str(error).split())}")


def forget_failures(folder: Path) -> None:
    """Remove what processes of an earlier try have said. Args: folder, of a run."""
    for path in folder.glob(FAILURES):
        path.unlink(missing_ok=True)


def recorder(values: Mapping[str, Any]) -> Callable:
    """What makes the `Run` of a config: `directory.record`, or the same with the directory of process 0.

    Args: values, of the config. Raises ConfigError for keys that do not belong together.
    """
    if not shared(values):
        return directory.record
    return _other if values["process"] else _first


@contextlib.contextmanager
def together(config: Mapping[str, Any]) -> Iterator[ProcessLine]:
    """The line to all other processes of a config, and JAX told of all their devices; ends when all of them are done.

    No process begins before all have come. Where one of them ends early, the block raises ProcessError within the
    second; where it computes what cannot be interrupted, the process ends with the same line `LIMIT` seconds later. To
    be entered by the main thread, before JAX touches a device.

    Args: config, of a `shared` run. Raises ConfigError where they do not meet.
    """
    coordinator, process, processes = _keys(config)
    about = {"processes": processes, "config": {k: v for k, v in config.items() if k not in OWN}}
    about["code"] = directory.git_state()
    line = ProcessLine(process)
    with line.signals():
        print(f"process {process} of {processes} meets the others at {coordinator}", flush=True)
        if process:
            wires = meeting.join(coordinator, process, about=about, patience=PATIENCE)
        else:
            wires = meeting.host(coordinator, processes, about=about, patience=PATIENCE)
        with line.watched(wires):
            _know_all_devices(coordinator, process, processes)
            line.limit = LIMIT
            yield line


def wait_for(files: Sequence[Path], run: Run, *, tick: Callable[[int], None] = lambda count: None) -> None:
    """Wait until all files of a run are there; it is `together` that raises where nobody is left to write them.

    Args: files, that other processes write; run, to which they belong; tick, told how many are missing. Raises
    UrbanJaxError where another process has said that it has failed.
    """
    missing = list(files)
    while missing := [path for path in missing if not path.exists()]:
        for path in run.directory.glob(FAILURES):
            raise UrbanJaxError(path.read_text("utf-8"))
        tick(len(missing))
        time.sleep(PAUSE)


@contextlib.contextmanager
def _first(folder: Path, config: Values, *, seed: Any = None, resolved: Values | None = None) -> Iterator[Run]:
    resolved = config if resolved is None else resolved
    with together(resolved) as line, directory.record(folder, config, seed=seed, resolved=resolved) as run:
        _keep(line, run)
        line.tell(str(run.directory.resolve()))
        for _ in range(1, resolved["processes"]):
            line.hear()  # all know it: from here on a manifest may be there
        yield run


@contextlib.contextmanager
def _other(folder: Path, config: Values, *, seed: Any = None, resolved: Values | None = None) -> Iterator[Run]:
    """The run of process 0, until that has ended it."""
    resolved = config if resolved is None else resolved
    with together(resolved) as line:
        theirs = Path(line.hear())
        if folder.resolve() != theirs:
            with contextlib.suppress(OSError):
                folder.rmdir()  # nothing is written there
        run = Run(theirs, config, seed, resolved=resolved)
        _keep(line, run)
        line.tell("begun")
        yield run
        print(f"process {resolved['process']} is done; run directory: {theirs}", flush=True)


def _keep(line: ProcessLine, run: Run) -> None:
    kept = os.path.relpath(run.directory)
    line.remedy = f"what has been computed is kept in {kept}; start all processes again with resume={kept}"


def _keys(config: Mapping[str, Any]) -> tuple[str, int, int]:
    return config.get("coordinator", ""), config.get("process", 0), config.get("processes", 1)


def _know_all_devices(coordinator: str, process: int, processes: int) -> None:
    """Have JAX know the devices of all processes, and hang up.

    They drive on devices of their own and share a disk, so nothing is left to say through JAX, whose coordination
    ends a process with an abort of its own as soon as another one is gone.
    """
    import jax

    jax.config.update("jax_enable_preemption_service", False)  # it would swallow SIGTERM
    host, port = meeting.address(coordinator)
    bind = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
    try:
        jax.distributed.initialize(
            coordinator,
            processes,
            process,
            coordinator_bind_address=bind if meeting.is_local(host) else None,
        )
    except RuntimeError as error:
        raise ConfigError(f"coordinator={coordinator}: no connection ({str(error).splitlines()[0]})") from error
    jax.devices()
    jax.distributed.shutdown()
