"""A run and its directory: results as they come, the manifest last."""

import contextlib
import csv
import hashlib
import json
import math
import os
import platform
import shlex
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

from urbanjax.io.runs import interpolation

MANIFEST, LOCK = "manifest.json", ".lock"
COMPLETE, FAILED = "complete", "failed"  # how a run ends
PACKAGES = ("urbanjax", "jax", "jaxlib", "numpy", "scipy", "flax", "highway-env")


class Run:
    """The directory of one run. Everything is written when it is known, so a failure keeps what came before."""

    def __init__(
        self,
        directory: Path,
        config: Mapping[str, Any],
        seed: int | str | None = None,
        *,
        resolved: Mapping[str, Any] | None = None,
        job: Mapping[str, Any] | None = None,
        again: bool = False,
    ):
        """Make the directory (a fresh one beside it when a run is there already, unless it is written `again`).

        Of a job of a sweep, which is told in `job`, it is the one that the sweep has for it. Args: config as it is
        written down; seed, likewise; resolved, the same with what its interpolations stand for, of which nothing but a
        hash is written; job, what the sweep says of it; again, see above.
        """
        self.directory = Path(directory) if again or job is not None else _fresh(directory)
        self.directory.mkdir(parents=True, exist_ok=True)
        self.job = dict(job or {})
        self.config = dict(config)
        self.resolved = self.config if resolved is None else dict(resolved)
        self.facts: dict[str, Callable[[], Any]] = {}  # of the manifest, asked when it is written
        self.seed = seed
        self.started = time.time()
        self._clock = time.perf_counter()
        self._summary: dict[str, float | int | None] = {}

    @property
    def swept(self) -> bool:
        """Whether it is a job of a sweep, which shows what all of them come to: it writes numbers alone."""
        return bool(self.job)

    def path(self, name: str) -> Path:
        """Where a file of this run goes."""
        return self.directory / name

    def table(self, name: str, columns: Mapping[str, Iterable[Any]]) -> None:
        """Write `columns` as `name.csv` and `name.parquet`."""
        import pyarrow
        import pyarrow.parquet

        data = {key: _listed(values) for key, values in columns.items()}
        lengths = {len(values) for values in data.values()}
        if len(lengths) > 1:
            raise ValueError(f"table '{name}' has columns of different lengths: {sorted(lengths)}")
        pyarrow.parquet.write_table(pyarrow.table(data), self.path(f"{name}.parquet"))
        with open(self.path(f"{name}.csv"), "w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(data)
            writer.writerows(zip(*data.values(), strict=True))

    def summary(self, values: Mapping[str, Any]) -> None:
        """Add to `summary.json`: flat, `name_with_unit` to a finite number or null."""
        self._summary.update({str(name): _number(value) for name, value in values.items()})
        write_atomically(self.path("summary.json"), json.dumps(self._summary, indent=2, allow_nan=False) + "\n")

    def finish(self, status: str, error: str | None = None) -> None:
        """Write `manifest.json`: what ran, on what, how it ended."""
        write_atomically(
            self.path(MANIFEST), json.dumps(self.manifest(status, error), indent=2, allow_nan=False) + "\n"
        )

    def manifest(self, status: str = "running", error: str | None = None) -> dict[str, Any]:
        """What is known of this run, as plain values."""
        return {
            "status": status,
            "error": error and interpolation.hidden(error, self.config, resolved=self.resolved),
            "command": shlex.join(sys.orig_argv),
            "started": time.strftime("%Y-%m-%dT%H:%M:%S%z", time.localtime(self.started)),
            "wall_time_s": round(time.perf_counter() - self._clock, 3),
            "seed": self.seed,
            "config": self.config,
            "config_sha256": digest(self.resolved),
            "git": git_state(),
            "versions": versions(),
            "device": device(),
            **{name: ask() for name, ask in self.facts.items()},
            "files": sorted(file.name for file in self.directory.iterdir() if file.name not in (MANIFEST, LOCK)),
            **({**self.job, "summary": self._summary} if self.swept else {}),
        }


@contextlib.contextmanager
def record(
    directory: Path,
    config: Mapping[str, Any],
    *,
    seed: int | str | None = None,
    resolved: Mapping[str, Any] | None = None,
) -> Iterator[Run]:
    """A `Run` whose manifest is written at the end, also of a failed run, and whose directory is printed last.

    Args: directory of the run; config, its parameters as plain values; seed of its random numbers, if it has one;
    resolved, the config with what its interpolations stand for.
    """
    run = Run(directory, config, seed, resolved=resolved)
    try:
        yield run
    except BaseException as error:
        run.finish(FAILED, f"{type(error).__name__}: {' '.join(str(error).split())}")
        raise
    else:
        run.finish(COMPLETE)
    finally:
        print(f"run directory: {os.path.relpath(run.directory)}", flush=True)


def write_atomically(path: Path, text: str) -> None:
    """Write `text` to `path` so that a reader sees all of it or none.

    Args: path of the file; text, all of it.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with open(temporary, "w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def digest(values: Mapping[str, Any]) -> str:
    """The SHA-256 of plain values, whatever the order of their keys. Args: values, nested."""
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()


def versions() -> dict[str, str | None]:
    """Versions of what decides the numbers; None for what is not installed."""
    found: dict[str, str | None] = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = None
    return found


def device() -> dict[str, Any]:
    """The accelerator or processor that JAX uses here."""
    import jax

    first = jax.devices()[0]
    return {"platform": first.platform, "kind": first.device_kind, "count": jax.device_count(), "cpu": _cpu()}


def git_state() -> dict[str, Any]:
    """Commit of the code that runs and whether it was changed since; None where it is no git work tree."""
    root = Path(__file__).resolve().parents[2]
    commit = _git(root, "rev-parse", "HEAD")
    changes = _git(root, "status", "--porcelain", "--untracked-files=no")
    return {"commit": commit, "dirty": None if changes is None else bool(changes)}


def _git(root: Path, *arguments: str) -> str | None:
    try:
        done = subprocess.run(["git", "-C", str(root), *arguments], capture_output=True, text=True, timeout=10)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def _cpu() -> str:
    names = []
    with contextlib.suppress(OSError), open("/proc/cpuinfo", encoding="utf-8") as file:
        names = [line.partition(":")[2].strip() for line in file if line.startswith("model name")]
    return f"{names[0] if names else platform.processor() or 'unknown'}, {os.cpu_count()} cores"


def _fresh(directory: Path) -> Path:
    candidate, number = Path(directory), 2
    while (candidate / MANIFEST).exists():
        candidate, number = Path(f"{directory}-{number}"), number + 1
    return candidate


def _listed(values: Any) -> list[Any]:
    values = values.tolist() if hasattr(values, "tolist") else values
    return [value.item() if hasattr(value, "item") else value for value in values]


def _number(value: Any) -> float | int | None:
    if value is None:
        return None
    value = value.item() if hasattr(value, "item") else value
    if isinstance(value, bool | int):
        return int(value)
    return float(value) if math.isfinite(value) else None
