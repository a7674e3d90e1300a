"""Numbers that tuning leaves alone: a class says which of those it holds, and why."""

import dataclasses
import functools
import re
from typing import Any

from urbanjax.types.errors import ConfigError

# What a reason begins with, up to its colon.
KINDS = {
    "safety": "a weight or limit that guards safety: a score that sees no accident would tune it away",
    "scale": "one weight of a sum of costs, which gives all of them their unit",
    "fact": "true of the vehicle, of a sensor or of the world, and so no choice",
    "definition": "says what a word of the stack means, such as standing",
    "numerics": "keeps a formula finite where it would degenerate",
    "soft": "only degrees of relaxed choices depend on it",
}
SOFT = "soft: only degrees of relaxed choices depend on it, and the stack that drives takes hard ones"


def pinned(params: Any, prefix: str = "") -> dict[str, str]:
    """Why they may not be tuned, by pattern of the dotted keys of numbers and groups.

    A class states it as PINNED, a dict of reasons by pattern relative to itself (`weights.collision`), each of which
    begins with one of KINDS. An empty one takes back what a class within it, or one that it adds to, says of the same
    pattern. Raises ConfigError for a reason of no kind. Args: params, of any class; prefix, dotted path of params.
    """
    stated: dict[str, str] = {}
    for cls in reversed(type(params).__mro__):
        stated |= vars(cls).get("PINNED", {})
    for key, why in stated.items():
        if why and why.partition(": ")[0] not in KINDS:
            raise ConfigError(f"{type(params).__name__}.PINNED['{key}'] must begin with one of {', '.join(KINDS)}")
    found = {f"{prefix}{key}": why for key, why in stated.items()}
    for spec in dataclasses.fields(params):
        value, name = getattr(params, spec.name), f"{prefix}{spec.name}"
        parts = {f"{name}[{i}]": part for i, part in enumerate(value)} if isinstance(value, tuple) else {name: value}
        for key, part in parts.items():
            if dataclasses.is_dataclass(part):
                found = pinned(part, f"{key}.") | found
    return found


def fits(key: str, pattern: str) -> bool:
    """Whether a pattern of `*` and `?` means a dotted key, the tuple that holds it, or a group that does.

    Brackets stand for themselves, as in `offsets[3]`. Args: key, of a number; pattern.
    """
    return _expression(pattern).fullmatch(key) is not None


@functools.cache
def _expression(pattern: str) -> re.Pattern[str]:
    meant = re.escape(pattern).replace(r"\*", ".*").replace(r"\?", ".")
    return re.compile(rf"{meant}([.\[].*)?", re.DOTALL)
