"""An experiment as Hydra calls it: one run, or one job of a sweep."""

import contextlib
import re
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

from urbanjax.io.runs import compile_cache, interpolation, parameter_file, presets, processes
from urbanjax.io.runs.directory import COMPLETE, FAILED, Run
from urbanjax.io.runs.disk import RUN_KEY, SWEEP_KEY, is_of_disk, of_disk
from urbanjax.io.runs.evaluations import Evaluation
from urbanjax.io.runs.sweeps import plan
from urbanjax.io.runs.sweeps.axes import stands_for_several
from urbanjax.types import ConfigError, ProcessError, UrbanJaxError, unread
from urbanjax.types import config as configs

T = TypeVar("T")
Body = Callable[[T, Run], None]
CONFIG_EXIT = 2
TRACEBACK = "traceback.txt"  # of a job that has raised what it should not


class Asked(NamedTuple):
    """What a config asks, with the values of its parameter file."""

    written: dict[str, Any]  # with interpolations, as it is written down
    resolved: dict[str, Any]  # with what they stand for
    params: Any


class Program(Generic[T]):
    """What a command line runs; other processes know it by its parts."""

    def __init__(
        self,
        name: str,
        params_class: type[T],
        body: Body,
        *,
        evaluation: Callable[[T, Run], Evaluation] | None = None,
        anew: bool = False,
    ) -> None:
        """A program of a name; `evaluation` is what its body drives, where it does, for many jobs at once.

        With `anew` it compiles everything itself.
        """
        self.name, self.params_class, self.body, self.evaluation = name, params_class, body, evaluation
        self.anew = anew

    def __call__(self, config: Any) -> None:
        """The run, or the job of a sweep, that Hydra asks for. Args: config, composed."""
        from hydra.core.hydra_config import HydraConfig
        from hydra.types import RunMode

        hydra = HydraConfig.get()
        folder = Path(hydra.runtime.output_dir)
        if hydra.mode == RunMode.MULTIRUN:
            self._job(folder, config, hydra)
        else:
            self._single(folder, config, hydra)

    def read(self, config: Any, hydra: Any, *, keys: Sequence[str] = ()) -> Asked:
        """What a config asks.

        What is typed stands above a parameter file, what a preset says below it; a file may hold values that nothing
        reads here. Args: config, composed; hydra, the part of it that is Hydra's own; keys, typed besides those that it
        says. Raises ConfigError.
        """
        arguments: Any = interpolation.plain(hydra.overrides.task, resolve=False)
        folders = [Path(source.path) for source in hydra.runtime.config_sources if source.schema == "file"]
        files = [*presets.named(arguments, folders)][::-1]  # the last one has the last word
        typed_keys = [*typed(arguments), *keys]
        schema = configs.schema(self.params_class)
        try:
            written, resolved = (interpolation.plain(own(config), resolve=resolve) for resolve in (False, True))
            file = str(resolved.pop(parameter_file.KEY, "") or "")
            written.pop(parameter_file.KEY, None)
            chosen = [*typed_keys, *unread.changed(resolved, schema)]
            written, resolved = (
                parameter_file.applied(values, file, keys=typed_keys, valid=schema) for values in (written, resolved)
            )
            params = configs.to_params(self.params_class, resolved, source=self._source(resolved, files))
            unread.check_read(params, [key for key in chosen if key != parameter_file.KEY])
        except ConfigError as error:
            key = re.search(r"'([\w.\[\]]+)'", str(error))
            places = [presets.place(file, key[1]) for file in files] if key and key[1] not in typed_keys else []
            told = next((f" ({place})" for place in places if place and place not in str(error)), "")
            raise ConfigError(f"{error}{told}") from error
        return Asked(written, resolved, params)

    def _source(self, values: dict[str, Any], files: Sequence[Path]) -> str:
        """The place in a preset of a key which the class does not have, for the message; empty when none brought it."""
        known = set(configs.keys(configs.schema(self.params_class)))
        unknown = [key for key in configs.keys(values) if key not in known]
        return next(filter(None, (presets.place(file, key) for key in unknown[:1] for file in files)), "")

    def _job(self, folder: Path, config: Any, hydra: Any) -> None:
        """One job of a sweep, if it is not done; what it raises is said in its manifest, and ends nothing else."""
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with plan.held(folder, wait=True):
                if plan.status_of(folder) == COMPLETE:
                    return
                run = job_run(folder, config)
                with ends_in_manifest(run):
                    asked = taken(run, self.read(config, hydra))
                    if processes.shared(run.resolved):
                        raise ConfigError("several processes share the jobs of hydra/launcher=vmap, of no other one")
                    with compile_cache.kept(run, anew=self.anew):
                        self.body(asked.params, run)
        except Exception as error:  # an engine may keep it to itself
            said = of_disk(error, folder, keys=[SWEEP_KEY]) if is_of_disk(error) else " ".join(str(error).split())
            print(f"job {folder.name}: {said}", file=sys.stderr, flush=True)
            raise

    def _single(self, folder: Path, config: Any, hydra: Any) -> None:
        try:  # ends the program from inside: what leaves a Hydra job as an exception is reported by Hydra too
            for text in map(str, interpolation.plain(hydra.overrides.task, resolve=False)):
                if stands_for_several(text.partition("=")[2]):
                    raise ConfigError(f"{text}: stands for several values; add -m to sweep over them")
            asked = self.read(config, hydra)
            record, seed = processes.recorder(asked.resolved), asked.written.get("seed")
            with (
                record(folder, asked.written, seed=seed, resolved=asked.resolved) as run,
                compile_cache.kept(run, anew=self.anew),
            ):
                self.body(asked.params, run)
        except (UrbanJaxError, OSError) as error:
            with contextlib.suppress(OSError):
                folder.rmdir()  # nothing was written
            if isinstance(error, OSError) and not is_of_disk(error):
                raise
            stop(of_disk(error, folder, keys=[RUN_KEY]) if isinstance(error, OSError) else str(error))


def job_run(folder: Path, config: Any) -> Run:
    """The run of a job, in the directory that the sweep has for it. Args: folder, the directory; config, composed."""
    sweep, planned = plan.job_in(folder)
    about = {"sweep": sweep, "job": planned.name, "overrides": planned.overrides}
    (folder / TRACEBACK).unlink(missing_ok=True)
    written = interpolation.plain(own(config), resolve=False)
    try:
        resolved = interpolation.plain(own(config), resolve=True)
    except ConfigError:  # which the job itself will tell
        resolved = written
    return Run(folder, written, job=about, resolved=resolved)


def taken(run: Run, asked: Asked) -> Asked:
    """What a job asks, which its run takes over. Args: run, of the job; asked."""
    run.config, run.resolved, run.seed = asked.written, asked.resolved, asked.written.get("seed")
    return asked


@contextlib.contextmanager
def ends_in_manifest(run: Run) -> Iterator[None]:
    """Write the manifest of a job when the block ends, also where it raises; what a full disk raises goes on.

    Args: run, of the job.
    """
    try:
        yield
        run.finish(COMPLETE)
    except Exception as error:
        if is_of_disk(error) or isinstance(error, ProcessError):
            raise
        fail(run, error)


def fail(run: Run, error: Exception) -> None:
    """Say in the manifest of a job why there is nothing of it. Args: run, of the job; error, what was raised."""
    if not isinstance(error, UrbanJaxError):
        told = "".join(traceback.format_exception(error))
        told = interpolation.hidden(told, run.config, resolved=run.resolved)
        run.path(TRACEBACK).write_text(told, encoding="utf-8")
    said = interpolation.hidden(" ".join(str(error).split()), run.config, resolved=run.resolved)
    run.finish(FAILED, f"{type(error).__name__}: {said}")
    print(f"job {run.directory.name} failed: {said or type(error).__name__}", file=sys.stderr, flush=True)


def own(config: Any) -> Any:
    """A copy of a config without what is Hydra's. Args: config, composed."""
    from omegaconf import OmegaConf

    return OmegaConf.masked_copy(config, [key for key in config if key != "hydra"])


def typed(overrides: Iterable[str]) -> list[str]:
    """The keys that somebody typed. Args: overrides, KEY=VALUE."""
    return [text.partition("=")[0].lstrip("+~") for text in overrides]


def stop(message: str) -> None:
    """End the program with one line. Args: message."""
    print(f"error: {' '.join(message.split())}", file=sys.stderr)
    sys.exit(CONFIG_EXIT)
