"""Directories named on the command line as one override that Hydra reads."""

import re
from collections.abc import Sequence
from pathlib import Path

# Options of Hydra whose value is the next argument.
WITH_VALUE = ("--cfg", "-c", "--package", "-p", "--config-path", "-cp", "--config-name", "-cn", "--config-dir", "-cd")
KEY = "dirs"


def to_overrides(arguments: Sequence[str]) -> list[str]:
    """The arguments with those that name a directory put together as `dirs=[...]`.

    A directory is what has no `=` and does not begin with `-`, and what does have one but is a directory that exists or
    has a `/` before it. Directories also given as `dirs=[...]` are an override of the same key: the last one counts.
    """
    others: list[str] = []
    named: list[str] = []
    for before, argument in zip(["", *arguments], arguments, strict=False):
        (named if before not in WITH_VALUE and is_directory(argument) else others).append(argument)
    return [*others, f"{KEY}=[{','.join(map(quoted, named))}]"] if named else others


def is_directory(argument: str) -> bool:
    """Whether an argument names a directory and not a key."""
    if not argument or argument.startswith("-") or (argument.startswith("~") and not argument.startswith("~/")):
        return False
    key, sign, _ = argument.partition("=")
    return not sign or "/" in key or Path(argument).is_dir()


def quoted(text: str) -> str:
    """A text as Hydra reads it back: whatever it holds, nothing of it means anything."""
    text = re.sub(r"(\\*)\$\{", r"\1\1\\${", text)  # OmegaConf would look up what it names
    text = re.sub(r'(\\*)("|$)', lambda found: 2 * found[1] + ('\\"' if found[2] else ""), text)
    return f'"{text}"'
