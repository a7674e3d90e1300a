"""Values that nothing reads: a class says which of those it holds, and setting one by hand is a mistake."""

import dataclasses
import fnmatch
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, NamedTuple

from urbanjax.types.errors import ConfigError


class Unread(NamedTuple):
    """Why nothing reads a value and what is read instead; and of which params of the class that holds it so is true."""

    why: str
    when: Callable[[Any], bool] = lambda params: True


def unread(params: Any, prefix: str = "") -> dict[str, str]:
    """Why nothing reads them, by pattern of the dotted keys of values and groups.

    A class states it as UNREAD, a dict of `Unread` by pattern relative to itself (`weights.*_scale`); None there takes
    back what a class within it, or one that it adds to, says of the same pattern. Args: prefix, dotted path of params.
    """
    stated: dict[str, Unread | None] = {}
    for cls in reversed(type(params).__mro__):
        stated |= vars(cls).get("UNREAD", {})
    found = {f"{prefix}{key}": rule.why if rule and rule.when(params) else "" for key, rule in stated.items()}
    for spec in dataclasses.fields(params):
        if dataclasses.is_dataclass(getattr(params, spec.name)):
            found = unread(getattr(params, spec.name), f"{prefix}{spec.name}.") | found
    return found


def check_read(params: Any, keys: Iterable[str]) -> None:
    """Raise ConfigError for the first key that nothing reads: why, and what to set instead.

    Args: keys, dotted, that somebody set.
    """
    rules = {pattern: why for pattern, why in unread(params).items() if why}
    for key in keys:
        for pattern, why in rules.items():
            if fnmatch.fnmatchcase(key, pattern) or fnmatch.fnmatchcase(key, f"{pattern}.*"):
                raise ConfigError(f"'{key}' is read by nothing here: {why}")


def changed(values: Mapping[str, Any], defaults: Mapping[str, Any], *, prefix: str = "") -> Iterator[str]:
    """Dotted keys of the values that differ. Args: values, nested; defaults, likewise; prefix, of their names."""
    for name, value in values.items():
        default = defaults.get(name)
        if isinstance(value, Mapping) and isinstance(default, Mapping):
            yield from changed(value, default, prefix=f"{prefix}{name}.")
        elif value != default:
            yield f"{prefix}{name}"
