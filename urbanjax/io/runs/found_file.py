"""Files of found encounters: JSON, the numbers of each by family and key, as `evaluation.missions.found` takes them."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from urbanjax.evaluation.missions.found import FoundScene, found_missions
from urbanjax.io import files
from urbanjax.io.runs.directory import write_atomically
from urbanjax.types import ConfigError

LARGEST = 10**4  # scenes


def write_found(path: Path, scenes: Sequence[FoundScene], *, about: str) -> None:
    """Write the file, whole or not at all.

    Args: path of it; scenes; about, what they are, in a line.
    """
    rows = [{"family": scene.family, "numbers": dict(scene.numbers)} for scene in scenes]
    write_atomically(path, json.dumps({"about": about, "scenes": rows}, indent=2, allow_nan=False) + "\n")


def read_found(path: str | Path) -> list[FoundScene]:
    """The scenes of a file, checked.

    Args: path of it. Raises FileError where there is none, ConfigError, naming the file, for what is no such file, a
    family or a number that there is not, and a value out of range.
    """
    source = files.file_of(path)
    try:
        held = json.loads(files.content(source).decode("utf-8"))
    except ValueError as error:
        raise ConfigError(f"{source}: is no JSON ({error}); give a file that the search for failures wrote") from error
    rows = held.get("scenes") if isinstance(held, dict) else None
    if not isinstance(rows, list) or not 0 < len(rows) <= LARGEST:
        raise ConfigError(f"{source}: needs a list 'scenes' of 1 to {LARGEST} entries")
    scenes = [_scene(row, f"{source}: scene {number}") for number, row in enumerate(rows)]
    try:
        found_missions(scenes)
    except ConfigError as error:
        raise ConfigError(f"{source}: {error}") from error
    return scenes


def _scene(row: Any, where: str) -> FoundScene:
    if not isinstance(row, dict) or set(row) != {"family", "numbers"}:
        raise ConfigError(f"{where}: must hold 'family' and 'numbers', and nothing else")
    family, numbers = row["family"], row["numbers"]
    if not isinstance(family, str) or not isinstance(numbers, dict):
        raise ConfigError(f"{where}: 'family' must be a name, and 'numbers' values by key")
    return FoundScene(family, numbers)
