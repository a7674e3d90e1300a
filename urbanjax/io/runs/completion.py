"""What a shell can complete on the command line of an experiment (`configs/complete.bash` asks for it)."""

import dataclasses
import enum
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from urbanjax.types import config as configs

QUERY = ["query=all"]  # after -sc: all of it, so that a shell asks but once
OPTIONS = ("--help ", "--cfg job", "--config-dir=", "-m ", "hydra.run.dir=")


def completions(params: Any, *, folders: Sequence[Path]) -> Iterator[str]:
    """Presets, then keys with each of the values that there are to choose from, or with what they are; then options.

    Args: folders in which folders of presets lie.
    """
    for folder in folders:
        yield from (f"preset={path.stem}" for path in sorted((folder / "preset").glob("*.yaml")))
    yield from _keys(params, "")
    yield from OPTIONS


def _keys(params: Any, prefix: str) -> Iterator[str]:
    for spec in configs.stated(params):
        key, value = f"{prefix}{spec.name}", getattr(params, spec.name)
        if dataclasses.is_dataclass(value):
            yield from _keys(value, f"{key}.")
        else:
            yield from [f"{key}={text}" for text in _values(spec, value)] or [f"{key}="]


def _values(spec: dataclasses.Field, value: Any) -> list[str]:
    chosen = [str(name) for name in spec.metadata.get("choices") or () if name != ""]
    if isinstance(value, tuple):
        plain = not any(dataclasses.is_dataclass(item) for item in value)
        return [f"[{name}]" for name in chosen] or ([f"[{','.join(map(_text, value))}]"] if plain else [])
    if isinstance(value, bool):
        return ["true", "false"]
    if isinstance(value, enum.Enum):
        return [member.name.lower() for member in type(value)]
    return chosen or ([_text(value)] if value != "" else [])


def _text(value: Any) -> str:
    return "null" if value is None else str(value.tolist() if hasattr(value, "tolist") else value)
