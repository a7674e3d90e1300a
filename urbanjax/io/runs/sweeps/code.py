"""What the numbers of a sweep depend on besides its config: sources, environment, and the files that it reads."""

import functools
import hashlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[4]


@functools.cache
def code_digest() -> str:
    """SHA-256 of all sources under `urbanjax/` and `experiments/`, with their paths."""
    digest = hashlib.sha256()
    for folder in ("urbanjax", "experiments"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            text = path.read_bytes()
            digest.update(f"{path.relative_to(ROOT).as_posix()} {len(text)}\n".encode())
            digest.update(text)
    return digest.hexdigest()


def settings() -> dict[str, str]:
    """What the environment says of where and how precisely JAX computes."""
    return {name: os.environ.get(name, "") for name in ("JAX_PLATFORMS", "JAX_ENABLE_X64")}


def state_of(path: str) -> list[tuple[str, int, int]] | None:
    """Name, bytes and time of change (ns) of a file, or of all in a folder; None where there is none of the name.

    Args: path of it.
    """
    named = Path(path)
    if not path or not named.exists():
        return None
    return sorted(_states(named, sorted(named.rglob("*")) if named.is_dir() else [named]))


def _states(root: Path, found: list[Path]) -> Iterator[Any]:
    for path in found:
        if path.is_file():
            known = path.stat()
            yield path.relative_to(root).as_posix(), known.st_size, known.st_mtime_ns
