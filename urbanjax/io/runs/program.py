"""An experiment as Hydra calls it: one run, or one job of a sweep."""

import contextlib
import errno
import os
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Generic, TypeGuard, TypeVar

from urbanjax.io.runs import parameter_file, processes
from urbanjax.io.runs.directory import Run
from urbanjax.io.runs.evaluations import Evaluation
from urbanjax.io.runs.sweeps import plan
from urbanjax.types import ConfigError, UrbanJaxError, unread
from urbanjax.types import config as configs

T = TypeVar("T")
Body = Callable[[T, Run], None]
CONFIG_EXIT = 2
UNWRITABLE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EACCES, errno.EPERM, errno.EIO)


class Program(Generic[T]):
    """What a command line runs; other processes know it by its parts."""

    def __init__(
        self, name: str, params_class: type[T], body: Body, evaluation: Callable[[T, Run], Evaluation] | None = None
    ) -> None:
        """A program of a name; `evaluation` is what its body drives, where it does, for many jobs at once."""
        self.name, self.params_class, self.body, self.evaluation = name, params_class, body, evaluation

    def __call__(self, config: Any) -> None:
        """The run, or the job of a sweep, that Hydra asks for. Args: config, composed."""
        from hydra.core.hydra_config import HydraConfig
        from hydra.types import RunMode

        hydra = HydraConfig.get()
        folder, keys = Path(hydra.runtime.output_dir), typed(hydra.overrides.task)
        if hydra.mode == RunMode.MULTIRUN:
            self._job(folder, config, keys)
        else:
            self._single(folder, config, keys)

    def read(self, config: Any, keys: Sequence[str], *, source: str = "") -> tuple[dict[str, Any], T]:
        """The values of a config, with those of its parameter file, and the params that they make.

        A file may hold values that nothing reads here. Args: config, composed; keys, typed on the command line; source,
        a file that may be wrong. Raises ConfigError.
        """
        schema = configs.schema(self.params_class)
        values = plain(config)
        file = values.pop(parameter_file.KEY, "")
        chosen = [*keys, *unread.changed(values, schema)]
        values = parameter_file.applied(values, file, keys=keys, valid=schema)
        params = configs.to_params(self.params_class, values, source=source)
        unread.check_read(params, [key for key in chosen if key != parameter_file.KEY])
        return values, params

    def _job(self, folder: Path, config: Any, keys: Sequence[str]) -> None:
        """One job of a sweep, if it is not done; what it raises is said in its manifest, and ends nothing else."""
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with plan.held(folder, wait=True):
                if plan.status_of(folder) == plan.COMPLETE:
                    return
                run = job_run(folder, plain(config))
                with ends_in_manifest(run):
                    run.config, params = self.read(config, keys)
                    if processes.shared(run.config):
                        raise ConfigError("several processes share the jobs of hydra/launcher=vmap, of no other one")
                    self.body(params, run)
        except OSError as error:
            print(f"job {folder.name}: {of_disk(error, folder)}", file=sys.stderr, flush=True)
            raise

    def _single(self, folder: Path, config: Any, keys: Sequence[str]) -> None:
        try:  # ends the program from inside: what leaves a Hydra job as an exception is reported by Hydra too
            values, params = self.read(config, keys, source=self._source(plain(config)))
            record = processes.recorder(values)
            with record(folder, values, seed=values.get("seed")) as run:
                self.body(params, run)
        except (UrbanJaxError, OSError) as error:
            with contextlib.suppress(OSError):
                folder.rmdir()  # nothing was written
            if isinstance(error, OSError) and not is_of_disk(error):
                raise
            stop(str(error) if isinstance(error, UrbanJaxError) else of_disk(error, folder))

    def _source(self, values: dict[str, Any]) -> str:
        """The preset file that brought a key which the class does not have, for the message; empty when none did."""
        from hydra.core.hydra_config import HydraConfig

        runtime = HydraConfig.get().runtime
        preset = runtime.choices.get("preset")
        unknown = set(configs.keys(values)) - {*configs.keys(configs.schema(self.params_class)), parameter_file.KEY}
        if not preset or not unknown:
            return ""
        folders = [Path(source.path) for source in runtime.config_sources if source.schema == "file"]
        files = [folder / "preset" / f"{preset}.yaml" for folder in folders]
        return next((os.path.relpath(file) for file in files if file.is_file()), "")


def job_run(folder: Path, values: Mapping[str, Any]) -> Run:
    """The run of a job, in the directory that the sweep has for it. Args: folder, the directory; values, its config."""
    sweep, planned = plan.job_in(folder)
    about = {"sweep": sweep, "job": planned.name, "overrides": planned.overrides}
    return Run(folder, values, values.get("seed"), job=about)


@contextlib.contextmanager
def ends_in_manifest(run: Run) -> Iterator[None]:
    """Write the manifest of a job when the block ends, also where it raises; what a full disk raises goes on.

    Args: run, of the job.
    """
    try:
        yield
        run.finish(plan.COMPLETE)
    except Exception as error:
        if is_of_disk(error):
            raise
        fail(run, error)


def fail(run: Run, error: Exception) -> None:
    """Say in the manifest of a job why there is nothing of it. Args: run, of the job; error, what was raised."""
    if not isinstance(error, UrbanJaxError):
        run.path("traceback.txt").write_text("".join(traceback.format_exception(error)), encoding="utf-8")
    said = " ".join(str(error).split())
    run.finish(plan.FAILED, f"{type(error).__name__}: {said}")
    print(f"job {run.directory.name} failed: {said or type(error).__name__}", file=sys.stderr, flush=True)


def plain(config: Any) -> dict[str, Any]:
    """A config as plain values. Raises ConfigError for an interpolation that fails. Args: config, composed."""
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    try:
        found: Any = OmegaConf.to_container(own(config), resolve=True)
    except OmegaConfBaseException as error:
        raise ConfigError(str(error).splitlines()[0]) from error
    return found


def own(config: Any) -> Any:
    """A copy of a config without what is Hydra's. Args: config, composed."""
    from omegaconf import OmegaConf

    return OmegaConf.masked_copy(config, [key for key in config if key != "hydra"])


def typed(overrides: Iterable[str]) -> list[str]:
    """The keys that somebody typed. Args: overrides, KEY=VALUE."""
    return [text.partition("=")[0].lstrip("+~") for text in overrides]


def is_of_disk(error: BaseException) -> TypeGuard[OSError]:
    """Whether it says that nothing can be written: a disk is full or a folder read-only. Args: error."""
    return isinstance(error, OSError) and error.errno in UNWRITABLE


def of_disk(error: OSError, folder: Path) -> str:
    """What is said of it. Args: error; folder, into which was written."""
    what = os.strerror(error.errno) if error.errno else str(error)
    return (
        f"{error.filename or folder}: {what}; make room there, or name another folder with hydra.run.dir or "
        "hydra.sweep.dir; what is written already is kept"
    )


def stop(message: str) -> None:
    """End the program with one line. Args: message."""
    print(f"error: {' '.join(message.split())}", file=sys.stderr)
    sys.exit(CONFIG_EXIT)
