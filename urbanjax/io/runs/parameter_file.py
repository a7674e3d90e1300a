"""Parameters in a file: values by dotted key, and of which version they are."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from urbanjax.types import ConfigError
from urbanjax.types.config import check_keys

KEY = "params"  # of the command line, that names a file


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


def read_parameters(path: Path) -> dict[str, Any]:
    raise ConfigError(f"{path}: to come")
