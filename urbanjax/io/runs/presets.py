"""Files of values (`configs/<experiment>/preset/*.yaml`): what they say first, and where in them something is wrong."""

import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from urbanjax.types import ConfigError

GLOBAL = "# @package _global_"  # without it Hydra puts what the file says below a key 'preset'
REMEDIES = {  # by what PyYAML says
    r"\\t": "indent with spaces",
    "duplicate key": "keep one of them",
    "mapping values are not allowed": "begin a line for each KEY: VALUE, and quote a text that holds ': '",
    "could not find expected ':'": "write KEY: VALUE",
    "expected <block end>": "begin all lines of one group in the same column",
    "constructor for the tag": "a file names values, never code; leave out the tag",
    "undefined alias": "write the value itself",
    "unterminated|end of stream|expected ',' or": "close what is open: a quote, a bracket or a brace",
}
OTHERWISE = "write lines of KEY: VALUE, indented with spaces"


def about(path: Path) -> str:
    """What a file says of itself: its first comment. Args: path of it."""
    with open(path, encoding="utf-8", errors="replace") as file:
        comments = [line[1:].strip() for line in file if line.startswith("#") and not line.startswith("# @")]
    return comments[0] if comments else ""


def named(overrides: Sequence[str], folders: Sequence[Path]) -> Iterator[Path]:
    """The files that a command line names. Args: overrides, as typed; folders in which groups of files lie."""
    for text in overrides:
        found = re.fullmatch(r"\+?([\w/]+)=\[?([\w\-./,]+)\]?", text)
        for name in found[2].split(",") if found else ():
            files = [folder / found[1] / f"{name.removesuffix('.yaml')}.yaml" for folder in folders if found]
            yield from [path for path in files if path.is_file()][:1]


def check(path: Path) -> None:
    """Raise ConfigError where a file holds no values: the file, line and column, and the remedy. Args: path of it."""
    import yaml

    try:
        text = path.read_bytes().decode("utf-8")
    except UnicodeDecodeError as error:
        before = error.object[: error.start]
        column = len(before.rpartition(b"\n")[2].decode("utf-8", "replace")) + 1
        raise _wrong(path, before.count(b"\n"), column - 1, "this is not UTF-8", "save the file as UTF-8") from error
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.YAMLError as error:
        raise ConfigError(problem_of(error, path)) from error
    if root is None:
        raise _wrong(path, 0, 0, "the file holds no values", "write lines of KEY: VALUE, or remove it")
    if not isinstance(root, yaml.MappingNode):
        kind = "a list" if isinstance(root, yaml.SequenceNode) else "a single value"
        raise _wrong(path, *_at(root), f"the file is {kind}", "write lines of KEY: VALUE")
    if path.parent.name == "preset" and not re.search(r"^# @package \S", text, re.MULTILINE):
        raise _wrong(path, 0, 0, "the file does not say that its keys begin at the root", f"begin it with '{GLOBAL}'")
    _check_node(path, root)


def problem_of(error: Exception, path: Path | None = None) -> str:
    """Where and what is wrong, with the remedy. Args: error, of PyYAML; path of the file, if the error has none."""
    mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
    problem = getattr(error, "problem", None) or getattr(error, "reason", None) or str(error).splitlines()[0]
    remedy = next((remedy for said, remedy in REMEDIES.items() if re.search(said, problem)), OTHERWISE)
    name = path or Path(getattr(mark, "name", None) or getattr(error, "name", None) or "a file of values")
    if mark is None:  # a character that YAML does not know, at its place in the text
        read = path.read_text("utf-8")[: getattr(error, "position", 0)] if path else ""
        at = (read.count("\n"), len(read.rpartition("\n")[2]))
        remedy = "remove this character"
    else:
        at = (mark.line, mark.column)
    return str(_wrong(name, *at, problem, remedy))


def place(path: Path, key: str) -> str:
    """The file with line and column of a key, empty where the file does not have it.

    Args: path of the file; key, dotted, with places in lists as `[2]`.
    """
    import yaml

    node, mark = yaml.compose(path.read_text("utf-8"), Loader=yaml.SafeLoader), None
    for name in re.findall(r"[^.\[\]]+", key):
        if isinstance(node, yaml.MappingNode):
            pair = next((pair for pair in node.value if pair[0].value == name), None)
            if pair is None:
                return ""
            mark, node = pair[0].start_mark, pair[1]
        elif isinstance(node, yaml.SequenceNode) and name.isdigit() and int(name) < len(node.value):
            node = node.value[int(name)]
            mark = node.start_mark
        else:
            return ""
    return f"{os.path.relpath(path)}, line {mark.line + 1}, column {mark.column + 1}" if mark else ""


def _check_node(path: Path, node: Any) -> None:
    """No key twice, and no interpolation that cannot be read."""
    import yaml
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    if isinstance(node, yaml.MappingNode):
        names = [name.value for name, _ in node.value]
        for i, (name, value) in enumerate(node.value):
            if name.value in names[:i]:
                first = node.value[names.index(name.value)][0].start_mark.line + 1
                raise _wrong(path, *_at(name), f"'{name.value}' stands in line {first} already", "keep one of them")
            _check_node(path, value)
    elif isinstance(node, yaml.SequenceNode):
        for value in node.value:
            _check_node(path, value)
    elif "${" in node.value:
        try:
            OmegaConf.create({"value": node.value})
        except OmegaConfBaseException as error:
            why = str(error).splitlines()[0]
            raise _wrong(path, *_at(node), f"cannot read {node.value!r} ({why})", "write ${KEY}") from error


def _at(node: Any) -> tuple[int, int]:
    return node.start_mark.line, node.start_mark.column


def _wrong(path: Path, line: int, column: int, problem: str, remedy: str) -> ConfigError:
    """The error. Args: line and column, counted from 0."""
    return ConfigError(f"{os.path.relpath(path)}, line {line + 1}, column {column + 1}: {problem}; {remedy}")
