"""What the numbers of a sweep depend on besides its config: the sources, and the environment."""

import functools
import hashlib
import os
from pathlib import Path

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
