"""Parameter files: values by dotted key that a person can read, and that come back bit for bit."""

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from urbanjax.io import files
from urbanjax.io.runs.directory import versions, write_atomically
from urbanjax.types import ConfigError
from urbanjax.types.config import check_keys

KEY = "params"  # of the command line, that names such a file
ENTRIES = ("urbanjax", "code", "values")
WIDTH = 10**6  # characters before YAML would break a line
# YAML 1.1 takes 1e-5 for a text; whoever edits a file means a number.
NUMBER = re.compile(r"^[-+]?(?:\d+\.?\d*|\.\d+)[eE][-+]?\d+$")


def write_parameters(path: Path, values: Mapping[str, Any], *, about: Mapping[str, str]) -> None:
    """Write a parameter file, whole or not at all.

    Args: path of it; values by dotted key: finite numbers, texts, switches and lists of them; about, what its first
    lines say, one comment for each entry, but "code", the hash of the sources, which becomes an entry of the file.
    Raises ConfigError for a value that is none of these.
    """
    import yaml

    for key, value in values.items():
        _check(key, value, source=str(path))
    head = [f"# {name}: {' '.join(str(text).split())}" for name, text in about.items() if name != "code"]
    entries = {"urbanjax": _version(), "code": str(about.get("code", "")), "values": dict(values)}
    text = yaml.dump(entries, Dumper=_dumper(), sort_keys=False, allow_unicode=True, width=WIDTH)
    write_atomically(path, "\n".join([*head, text]))


def read_parameters(path: Path) -> dict[str, Any]:
    """The values of a parameter file by dotted key.

    Args: path of it. Raises ConfigError, naming the file, for what is no YAML (with line and column), an entry that no
    such file has, a missing version, the version of another urbanjax, and values that are not by dotted key. Raises
    FileError where there is no such file.
    """
    entries = _entries(path)
    unknown = [str(name) for name in entries if name not in ENTRIES]
    if unknown:
        raise ConfigError(f"{path}: has no use for the entry '{unknown[0]}': values belong under 'values'")
    written, here = str(entries.get("urbanjax") or ""), _version()
    if not written:
        raise ConfigError(f"{path}: does not say of which version it is: add the line 'urbanjax: {here}'")
    if written != here:
        raise ConfigError(
            f"{path}: is of urbanjax {written}, this is {here}, whose parameters may mean something else; if its "
            f"values are wanted anyway, write 'urbanjax: {here}' in it"
        )
    values = entries.get("values", {})
    if not isinstance(values, Mapping):
        raise ConfigError(f"{path}: 'values' must hold one line 'dotted.key: value' for each, not {values!r}")
    for key, value in values.items():
        _check(key, value, source=str(path))
    return dict(values)


def applied(values: Mapping[str, Any], file: str, *, keys: Sequence[str], valid: Mapping[str, Any]) -> dict[str, Any]:
    """The values of a config with those of a parameter file in their place, but for the keys that were typed.

    Args: values, nested; file, its path, empty for none; keys, typed on the command line; valid, nested values with all
    the keys that there are. Raises ConfigError for a key of the file that there is not.
    """
    found = {name: value for name, value in values.items()}
    for key, value in (read_parameters(Path(file)) if file else {}).items():
        *groups, name = key.split(".")
        nested: dict[str, Any] = {name: value}
        for group in reversed(groups):
            nested = {group: nested}
        check_keys(nested, valid, source=file)
        if not any(key == typed or key.startswith(f"{typed}.") for typed in keys):
            found = _merged(found, nested)
    return found


def _merged(values: Mapping[str, Any], other: Mapping[str, Any]) -> dict[str, Any]:
    both = {
        name: _merged(values[name], value)
        if isinstance(value, Mapping) and isinstance(values.get(name), Mapping)
        else value
        for name, value in other.items()
    }
    return {**values, **both}


def _entries(path: Path) -> Mapping[Any, Any]:
    """The content of the file as YAML."""
    import yaml

    try:
        text = files.content(files.file_of(path)).decode("utf-8")
        entries = yaml.load(text, _loader())
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: is no text in UTF-8 (byte {error.start})") from error
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        why = getattr(error, "problem", None) or getattr(error, "reason", None) or type(error).__name__
        raise ConfigError(f"{path}{where}: is no YAML: {why}") from error
    except (ValueError, RecursionError) as error:  # dates and numbers that are none, nesting without end
        raise ConfigError(f"{path}: is no YAML: {' '.join(str(error).split())}") from error
    if not isinstance(entries, Mapping):
        raise ConfigError(f"{path}: must hold the entries {', '.join(ENTRIES)}")
    return entries


def _loader() -> Any:
    """YAML's safe loader, which here refuses a key that stands twice."""
    import yaml

    class ParameterLoader(yaml.SafeLoader):
        """Refuses what would silently be lost."""

        def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
            """The mapping. Args: node of it; deep, whether all below is made at once."""
            seen = set()
            for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
                if key.value in seen:
                    raise yaml.constructor.ConstructorError(problem=f"'{key.value}' twice", problem_mark=key.start_mark)
                seen.add(key.value)
            return super().construct_mapping(node, deep)

    return _with_numbers(ParameterLoader)


def _dumper() -> Any:
    """YAML's safe dumper, which here puts quotes around a text that the loader would take for a number."""
    import yaml

    return _with_numbers(type("ParameterDumper", (yaml.SafeDumper,), {}))


def _with_numbers(cls: Any) -> Any:
    cls.add_implicit_resolver("tag:yaml.org,2002:float", NUMBER, [*"-+.0123456789"])
    return cls


def _check(key: Any, value: Any, *, source: str) -> None:
    """Raise ConfigError for what a parameter file cannot hold."""
    if not isinstance(key, str) or not key:
        raise ConfigError(f"{source}: {key!r} is no dotted key")
    for item in value if isinstance(value, list | tuple) else [value]:
        if not isinstance(item, bool | int | float | str) or (isinstance(item, float) and not math.isfinite(item)):
            raise ConfigError(f"{source}: '{key}' must be a finite number, a text, true, false or a list, not {item!r}")


def _version() -> str:
    return versions()["urbanjax"] or "unknown"
