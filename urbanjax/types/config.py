"""From the params classes to a config, and from a config back to checked params.

A default lives in its params class only. `schema` turns a class into nested plain values (what Hydra shows and
overrides), `to_params` turns such values back into the class and refuses whatever the class does not say.
"""

import dataclasses
import difflib
import enum
import math
import typing
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, TypeVar

from urbanjax.types.errors import ConfigError
from urbanjax.types.limits import FieldLimits, instead, limits_of

T = TypeVar("T")
MOST = 2**53  # of a whole number that says nothing of its range
FORBIDDEN = "_target_"  # a config names values, never code


def default_of(spec: dataclasses.Field) -> Any:
    """The default of one field. Raises ConfigError when its class gives none. Args: spec, a field of a params class."""
    if spec.default is not dataclasses.MISSING:
        return spec.default
    if spec.default_factory is not dataclasses.MISSING:
        return spec.default_factory()
    raise ConfigError(f"parameter '{spec.name}' has no default in its params class")


def schema(params_class: type) -> dict[str, Any]:
    """Nested dict of the defaults of `params_class`, in plain values that YAML can hold.

    A field that is handed down (`types.struct.HANDED_DOWN`) is no key: whoever holds the params fills it in.
    Args: params_class, with a default for each field.
    """
    return {spec.name: _plain(default_of(spec)) for spec in stated(params_class)}


def plain(params: Any) -> dict[str, Any]:
    """Nested dict of the values of `params` (Python numbers), the inverse of `to_params`."""
    return {spec.name: _plain(getattr(params, spec.name)) for spec in stated(params)}


def stated(params: Any) -> list[dataclasses.Field]:
    """The fields of a params class or instance that are keys of a config."""
    return [spec for spec in dataclasses.fields(params) if not spec.metadata.get("handed_down")]


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value):
        return plain(value)
    if isinstance(value, enum.Enum):
        return value.name.lower()
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    if value is None or isinstance(value, bool | int | float | str):
        return value
    return value.tolist()


def keys(tree: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    """Dotted names of all groups and values of a nested config.

    Args: tree, nested groups and values; prefix, of their names.
    """
    for name, value in tree.items():
        yield f"{prefix}{name}"
        if isinstance(value, Mapping):
            yield from keys(value, f"{prefix}{name}.")


def nearest(key: str, valid: Iterable[str]) -> str:
    """The valid dotted key that looks most like `key`, as a clause for a message; empty when there is none.

    Args: key, dotted; valid, dotted keys.
    """
    valid = list(valid)
    last = [name for name in valid if name.rpartition(".")[2] == key.rpartition(".")[2]]
    found = difflib.get_close_matches(key, last or valid, n=1, cutoff=0.0)
    return f"; the nearest valid key is '{found[0]}'" if found else ""


def check_keys(config: Mapping[str, Any], valid: Mapping[str, Any], *, source: str = "", prefix: str = "") -> None:
    """Raise ConfigError for the first key of `config` that `valid` does not have, with the nearest one that it has.

    Args: config, nested values; valid, nested values with all the keys there are; source, the file or command that the
    config came from; prefix, dotted path of both mappings.
    """
    root = list(keys(valid, prefix))
    where = f" in {source}" if source else ""
    for name, value in config.items():
        key = f"{prefix}{name}"
        if name == FORBIDDEN:
            raise ConfigError(f"key '{key}'{where} is refused: a config names values, never code")
        if name not in valid:
            raise ConfigError(f"unknown key '{key}'{where}{nearest(key, root)}")
        if isinstance(value, Mapping) and isinstance(valid[name], Mapping):
            check_keys(value, valid[name], source=source, prefix=f"{key}.")


def to_params(params_class: type[T], config: Mapping[str, Any], *, prefix: str = "", source: str = "") -> T:
    """An instance of `params_class` with the values of `config`; what it leaves out keeps its default.

    Args: params_class, with a default for each field; config, nested plain values; prefix, dotted path of `config` for
    messages (ends in a dot); source, the file it came from. Raises ConfigError in one line for an unknown key (with the
    nearest valid one), a wrong type, a non-finite number, a negative size, a value out of the field's range and an
    empty grid.
    """
    check_keys(config, schema(params_class), source=source, prefix=prefix)
    return updated(params_class(), config, prefix=prefix)


def updated(params: T, config: Mapping[str, Any], *, prefix: str = "") -> T:
    """`params` with the values of `config`, checked; what it leaves out stays as it is, at every depth.

    Args: config, nested plain values with keys of the params; prefix, dotted path for messages. Raises ConfigError.
    """
    specs = {spec.name: spec for spec in stated(params)}
    values = {
        name: _convert(specs[name], getattr(params, name), value, f"{prefix}{name}") for name, value in config.items()
    }
    return dataclasses.replace(typing.cast(Any, params), **values)


def _convert(spec: dataclasses.Field, current: Any, value: Any, key: str) -> Any:
    """The value of one field. Its default says of which kind it is, the current value what a group leaves out."""
    default = default_of(spec)
    if value is None and (default is None or type(None) in typing.get_args(spec.type)):
        return None
    group = next((held for held in (current, default) if dataclasses.is_dataclass(held)), None)
    if group is not None:
        return _group(group, value, key)
    if isinstance(default, enum.Enum):
        return _member(type(default), value, key)
    if isinstance(default, tuple):
        return _grid(spec, current, value, key)
    return _scalar(_like(default, spec), value, key, limits_of(spec))


def _group(current: Any, value: Any, key: str) -> Any:
    if not isinstance(value, Mapping):
        raise ConfigError(f"'{key}' is a group of values, not {value!r}")
    check_keys(value, plain(current), prefix=f"{key}.")
    return updated(current, value, prefix=f"{key}.")


def _like(default: Any, spec: dataclasses.Field) -> Any:
    """A value of the kind that a field without a default value holds: of `float | None`, 0."""
    kinds = [kind for kind in typing.get_args(spec.type) if kind in (bool, int, float, str)]
    return kinds[0]() if default is None and kinds else default


def _member(kind: type[enum.Enum], value: Any, key: str) -> enum.Enum:
    names = {member.name.lower(): member for member in kind}
    if not isinstance(value, str) or value.lower() not in names:
        raise ConfigError(f"'{key}' must be one of {', '.join(names)}, not {value!r}")
    return names[value.lower()]


def _grid(spec: dataclasses.Field, current: tuple, value: Any, key: str) -> tuple:
    """The elements; those that are groups keep what the config leaves out, the ones beyond the current as the last."""
    default = default_of(spec)
    if not isinstance(value, list | tuple):
        raise ConfigError(f"'{key}' must be a list, not {value!r}")
    if not value and default and not spec.metadata.get("may_be_empty"):
        raise ConfigError(f"'{key}' must not be empty")
    like = current or default
    first = like[0] if like else typing.get_args(spec.type)[0]()
    if dataclasses.is_dataclass(first):
        held = [like[min(i, len(like) - 1)] if like else first for i in range(len(value))]
        return tuple(_group(held[i], item, f"{key}[{i}]") for i, item in enumerate(value))
    first = default[0] if default else first
    free = -1.0 if isinstance(first, float) else first  # elements of a grid may be negative
    return tuple(_scalar(free, item, f"{key}[{i}]", limits_of(spec)) for i, item in enumerate(value))


def _scalar(default: Any, value: Any, key: str, limits: FieldLimits) -> Any:
    better = instead(value, choices=limits.choices, bounds=None)
    _expect(not better, value, key, better)
    if isinstance(default, bool):
        return _expect(isinstance(value, bool), value, key, "true or false")
    if isinstance(default, str):
        return _expect(isinstance(value, str), value, key, "a text")
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if isinstance(default, int):
        _expect(number and float(value).is_integer(), value, key, "a whole number")
        _expect(limits.bounds is not None or value <= MOST, value, key, f"at most {MOST}")
        value = int(value)
    elif isinstance(default, float):
        _expect(number and math.isfinite(value), value, key, "a finite number")
        value = float(value)
    else:
        return value
    better = instead(value, choices=None, bounds=limits.bounds or (_lowest(default), math.inf))
    return _expect(not better, value, key, better)


def _expect(condition: bool, value: Any, key: str, kind: str) -> Any:
    if not condition:
        raise ConfigError(f"'{key}' must be {kind}, not {value!r}")
    return value


def bounds_of(spec: dataclasses.Field) -> tuple[float, float]:
    """Least and greatest that a config may give to the number of a field, or to each of its tuple.

    Args: spec, of a field of floats.
    """
    limits, default = limits_of(spec).bounds, default_of(spec)
    free = -1.0 if isinstance(default, tuple) else _like(default, spec)  # elements of a grid may be negative
    low, high = limits or (_lowest(free), math.inf)
    return float(low), float(high)


def _lowest(default: float | int) -> float | int:
    """Sizes and magnitudes (a positive default) are not negative; a count that is at least 1 stays so."""
    if isinstance(default, int):
        return 1 if default >= 1 else 0
    return 0.0 if default > 0.0 else -math.inf
