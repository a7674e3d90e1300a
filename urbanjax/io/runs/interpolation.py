"""What a config takes from elsewhere (`${oc.env:NAME}`): what runs has the value, what is written keeps the text."""

import re
from collections.abc import Iterator, Mapping
from typing import Any

from urbanjax.types import ConfigError

MARK = "${"
SHORTEST = 4  # letters of a value that is looked for in a message: shorter ones stand everywhere by chance


def plain(config: Any, *, resolve: bool) -> Any:
    """Nested plain values of a config. Raises ConfigError, which names the key, for what cannot be resolved.

    Args: config, of OmegaConf; resolve, whether interpolations become what they stand for, or stay as written.
    """
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    try:
        return OmegaConf.to_container(config, resolve=resolve)
    except OmegaConfBaseException as error:
        raise ConfigError(unresolved(error)) from error


def resolved(values: Mapping[str, Any]) -> dict[str, Any]:
    """Nested plain values with what their interpolations stand for now. Raises ConfigError, which names the key.

    Args: values, nested, as a manifest has them.
    """
    from omegaconf import OmegaConf

    return plain(OmegaConf.create(dict(values)), resolve=True)


def unresolved(error: Exception) -> str:
    """What is wrong with an interpolation, with the remedy. Args: error, of OmegaConf."""
    text, name = str(error).splitlines()[0], getattr(error, "full_key", None)
    key = f"'{name}': " if name else ""
    variable = re.search(r"Environment variable '([^']+)' not found", text)
    if variable:
        return f"{key}the environment has no {variable[1]}; set it, or give a default as in ${{oc.env:NAME,DEFAULT}}"
    if "nterpolation" in text:
        return f"{key}{text}; name another key as ${{KEY.KEY}}, or something of the environment as ${{oc.env:NAME}}"
    return f"{key}{text}"


def hidden(text: str, config: Mapping[str, Any], *, resolved: Mapping[str, Any]) -> str:
    """The text with interpolations in the place of what they stand for.

    Args: text, a message; config, nested, as it is written; resolved, the same with what interpolations stand for.
    """
    for written, value in _pairs(config, resolved):
        if isinstance(written, str) and MARK in written and isinstance(value, str) and len(value) >= SHORTEST:
            text = text.replace(value, written)
    return text


def _pairs(config: Any, resolved: Any) -> Iterator[tuple[Any, Any]]:
    if isinstance(config, Mapping) and isinstance(resolved, Mapping):
        for name, value in config.items():
            yield from _pairs(value, resolved.get(name))
    elif isinstance(config, list) and isinstance(resolved, list):
        for written, value in zip(config, resolved, strict=True):
            yield from _pairs(written, value)
    else:
        yield config, resolved
