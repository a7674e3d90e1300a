"""Of which kind the value of a field is: what its annotation says, as far as a caller can get it wrong."""

import dataclasses
import types
import typing
from typing import Any, NamedTuple

import numpy as np

PLAIN = (bool, int, float, str)
NUMBERS = (int, float)
WRONG = (str, bytes, bool, int, float, complex, list, dict, set, tuple, type)  # that no leaf or placeholder is


class Kinds(NamedTuple):
    """What a field holds, by its annotation."""

    classes: tuple[type, ...]  # plain ones, records and tuple
    fixed: bool  # part of the tree's structure, so that JAX puts nothing in its place
    elements: tuple["Kinds", ...] = ()  # of a tuple
    alike: bool = False  # any number of elements, all of the first kind

    @property
    def several(self) -> bool:
        """Whether it may be a tuple."""
        return tuple in self.classes


def kinds_of(spec: dataclasses.Field) -> Kinds | None:
    """What a field holds; None where its annotation says nothing that is checked. Args: spec, of a params class."""
    return _kinds(spec.type, fixed=not spec.metadata.get("pytree_node", True))


def ought(value: Any, kinds: Kinds) -> str:
    """What `value` should be, as in "a whole number"; empty where it may be what it is.

    Where JAX may hold something else in the place of a value, everything passes that it might: arrays, tracers, None,
    placeholders. Args: value, of a field; kinds, what it holds.
    """
    if value is None:
        return "" if types.NoneType in kinds.classes or not kinds.fixed else _named(kinds)
    if isinstance(value, tuple | list) and kinds.several:
        return _elements(value, kinds)
    return "" if any(_fits(value, cls, kinds.fixed) for cls in kinds.classes) else _named(kinds)


def _kinds(annotation: Any, fixed: bool) -> Kinds | None:
    parts = typing.get_args(annotation) if _is_union(annotation) else (annotation,)
    classes: list[type] = []
    elements: tuple[Kinds, ...] = ()
    alike = False
    for part in parts:
        if typing.get_origin(part) is tuple:
            inner = typing.get_args(part)
            alike = inner[-1:] == (...,)
            found = [_kinds(each, fixed) for each in (inner[:1] if alike else inner)]
            if None in found:
                return None
            classes.append(tuple)
            elements = tuple(each for each in found if each)
        elif isinstance(part, type) and (part in (*PLAIN, types.NoneType) or dataclasses.is_dataclass(part)):
            classes.append(part)
        else:
            return None
    return Kinds(tuple(classes), fixed, elements, alike)


def _is_union(annotation: Any) -> bool:
    return typing.get_origin(annotation) in (typing.Union, types.UnionType)


def _elements(value: tuple | list, kinds: Kinds) -> str:
    inner = kinds.elements * len(value) if kinds.alike else kinds.elements
    if len(inner) != len(value):
        return f"{len(inner)} values"
    return next((f"a tuple, of which each is {text}" for text in map(ought, value, inner) if text), "")


def _fits(value: Any, cls: type, fixed: bool) -> bool:
    if cls is bool or cls is str:
        return isinstance(value, (bool, np.bool_) if cls is bool else str) or not (fixed or _wrong(value))
    if cls in NUMBERS:
        if isinstance(value, bool):
            return False
        real = (int, np.integer) if cls is int and fixed else (int, float, np.integer, np.floating)
        return isinstance(value, real) or not (fixed or _wrong(value))
    return isinstance(value, cls) or not _wrong(value)


def _wrong(value: Any) -> bool:
    """Whether a value is nothing that JAX puts in the place of another."""
    return isinstance(value, WRONG) or dataclasses.is_dataclass(value)


def _named(kinds: Kinds) -> str:
    said = {int: "a whole number", float: "a number", str: "a text", bool: "true or false", tuple: "a tuple"}
    said[types.NoneType] = "None"
    return " or ".join(said.get(cls, f"a {cls.__name__}") for cls in kinds.classes)
