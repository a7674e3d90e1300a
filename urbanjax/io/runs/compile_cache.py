"""Programs that are compiled once: JAX keeps them on disk, in a folder that nobody else can write to.

Whoever can write a compiled program can have it run, so a folder that others can write to is not used. What JAX is
told by its own settings (`JAX_COMPILATION_CACHE_DIR`, `JAX_ENABLE_COMPILATION_CACHE=false`) holds.
"""

import contextlib
import hashlib
import json
import os
import platform
import re
import stat
import sys
import warnings
from collections import Counter
from collections.abc import Iterator
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

from urbanjax.io.runs.directory import Run
from urbanjax.types import FileError

MOST = 2**30  # bytes of all programs kept; those used longest ago make room
PARTS = ("jax", "jaxlib", "jax-cuda12-plugin", "jax-cuda13-plugin", "jax-rocm7-plugin")  # what compiles
# Of 310 programs of a small evaluation 12 take longer than 0.1 s to compile; the others together take 4 s, and 1 MB.
EVERYTHING = {"jax_persistent_cache_min_compile_time_secs": 0.0, "jax_persistent_cache_min_entry_size_bytes": 0}
EVENTS = "/jax/compilation_cache/"
UNUSABLE = r"Error (?:reading|writing) persistent compilation cache entry for '([^']*)'"
SHARED = stat.S_IWGRP | stat.S_IWOTH


@contextlib.contextmanager
def kept(run: Run, *, anew: bool = False) -> Iterator[None]:
    """Within it programs come from the disk where they are there; in the end a line and the manifest say how many.

    Args: run, whose manifest has it; anew, whether everything is to be compiled, as where its time is measured.
    """
    folder, why = _off() if anew else _on()
    before, unusable = Counter(_events()), []
    run.facts["compiled"] = lambda: _counted(folder, why, before, unusable)
    with _unusable(unusable):
        yield
    _remove(folder, unusable, run.started)
    told = _counted(folder, why, before, unusable)
    if told["programs"]:
        print(_line(told), flush=True)


def folder_of(base: Path) -> Path:
    """The private folder for programs of this machine and these versions, made if need be.

    Args: base, the folder of all caches. Raises FileError where others can write to it, OSError where
    it cannot be made.
    """
    base.mkdir(mode=0o700, parents=True, exist_ok=True)
    for above in (base.resolve(), *base.resolve().parents):
        mode = above.stat().st_mode
        if mode & SHARED and not mode & stat.S_ISVTX:  # in a sticky folder nobody moves what is somebody else's
            raise FileError(f"others can write to {above}; 'chmod go-w' it, or set XDG_CACHE_HOME to another folder")
    folder = base.resolve()
    for name in ("urbanjax", "compiled", key()):
        folder = folder / name
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
        if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.geteuid() or found.st_mode & SHARED:
            raise FileError(f"{folder} is not a folder of your own that nobody else can write to; remove it")
    return folder


@cache
def key() -> str:
    """What a compiled program depends on besides itself: versions and the processor with all that it can do."""
    versions = {}
    for name in PARTS:
        with contextlib.suppress(metadata.PackageNotFoundError):
            versions[name] = metadata.version(name)
    facts = [platform.python_version(), versions, sys.platform, platform.machine(), platform.processor(), _processor()]
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:16]


def bound(folder: Path, most: int = MOST) -> None:
    """Remove the files below a folder that were used longest ago, until the others are small enough.

    Args: folder of kept programs; most, bytes that may stay.
    """
    found = []
    for path in folder.rglob("*"):
        with contextlib.suppress(OSError):  # another process may do the same
            is_file, state = path.is_file(), path.lstat()
            found += [(max(state.st_atime, state.st_mtime), state.st_size, path)] if is_file else []
    total = 0
    for _, size, path in sorted(found, reverse=True):
        total += size
        if total > most:
            with contextlib.suppress(OSError):
                path.unlink()


def _on() -> tuple[Path | None, str]:
    """The folder in use, or why there is none. Touches no device: other processes may have to be waited for first."""
    import jax

    if not jax.config.jax_enable_compilation_cache:
        return None, "JAX_ENABLE_COMPILATION_CACHE is false"
    if theirs := jax.config.jax_compilation_cache_dir:
        return Path(theirs), ""
    try:
        folder = folder_of(_base())
    except (OSError, RuntimeError, FileError) as error:
        why = str(error)
        print(f"note: compiled programs are not kept: {why}", file=sys.stderr)
        return None, why
    bound(folder.parent)
    jax.config.update("jax_compilation_cache_dir", str(folder))
    for name, value in EVERYTHING.items():
        if name.upper() not in os.environ:
            jax.config.update(name, value)
    return folder, ""


def _off() -> tuple[None, str]:
    import jax

    jax.config.update("jax_enable_compilation_cache", False)
    return None, "compile times are measured here"


def _base() -> Path:
    if not hasattr(os, "geteuid"):
        raise FileError("who else can write to a folder is not known on this system")
    given = os.environ.get("XDG_CACHE_HOME", "")
    if os.path.isabs(given):
        return Path(given)
    if not Path.home().is_dir():
        raise FileError(f"there is no home folder {Path.home()}; set XDG_CACHE_HOME to a folder of your own")
    return Path.home() / ".cache"


def _processor() -> list[str]:
    """Model and features of the first processor."""
    lines = []
    with contextlib.suppress(OSError), open("/proc/cpuinfo", encoding="utf-8", errors="replace") as file:
        lines = file.read().partition("\n\n")[0].splitlines()
    wanted = ("model name", "flags", "Features", "CPU implementer", "CPU part")
    return [" ".join(sorted(line.partition(":")[2].split())) for line in lines if line.startswith(wanted)]


@cache
def _events() -> Counter:
    """What JAX has told so far of its cache, by event."""
    from jax import monitoring

    events: Counter = Counter()

    def note(event: str, **_: Any) -> None:
        if event.startswith(EVENTS):
            events[event.removeprefix(EVENTS)] += 1

    def note_seconds(event: str, duration_secs: float, **_: Any) -> None:
        if event == "/jax/core/compile/backend_compile_duration":
            events["programs"] += 1

    monitoring.register_event_listener(note)
    monitoring.register_event_duration_secs_listener(note_seconds)
    return events


@contextlib.contextmanager
def _unusable(names: list[str]) -> Iterator[None]:
    """Within it the names of programs whose file can't be read or written are noted: JAX warns, and compiles them."""
    with warnings.catch_warnings():
        shown = warnings.showwarning

        def hear(message: Warning | str, *details: Any, **named: Any) -> None:
            found = re.match(UNUSABLE, str(message))
            if found:
                names.append(found[1])
            else:
                shown(message, *details, **named)

        warnings.filterwarnings("always", UNUSABLE)
        warnings.showwarning = hear
        yield


def _remove(folder: Path | None, names: list[str], before: float) -> None:
    """Remove the files of these programs, which JAX would neither read nor write again.

    Those written since `before` [s] stay: they were read while another process still wrote them.
    """
    for path in [path for name in set(names) for path in folder.glob(f"{name}-*")] if folder else ():
        with contextlib.suppress(OSError):
            if path.stat().st_mtime < before:
                path.unlink()


def _counted(folder: Path | None, why: str, before: Counter, unusable: list[str]) -> dict[str, Any]:
    """What is said of it: names and numbers."""
    since = _events() - before
    return {
        "folder": _short(folder) if folder else None,
        "why_not": why or None,
        "programs": since["programs"],
        "from_folder": since["cache_hits"],
        "kept_anew": since["cache_misses"] if folder else 0,
        "unusable": len(unusable),
    }


def _short(folder: Path) -> str:
    with contextlib.suppress(RuntimeError, ValueError):
        return str(Path("~") / folder.relative_to(Path.home()))
    return str(folder)


def _line(told: dict[str, Any]) -> str:
    if not told["folder"]:
        return f"compiled programs: {told['programs']} new, none kept ({told['why_not']})"
    new = told["programs"] - told["from_folder"]
    broken = f", {told['unusable']} that could not be read" if told["unusable"] else ""
    return f"compiled programs: {told['from_folder']} from {told['folder']}, {new} new{broken}"
