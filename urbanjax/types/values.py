"""Params with some values changed: one set, or a batch of them along a leading axis."""

import dataclasses
import functools
from collections.abc import Mapping
from typing import Any, TypeVar, cast

import jax
import jax.numpy as jnp
import numpy as np

from urbanjax.types.arguments import traced
from urbanjax.types.config import check_keys, plain, stated, updated
from urbanjax.types.errors import ConfigError

T = TypeVar("T")


def with_values(params: T, values: Mapping[str, Any]) -> T:
    """`params` with some of their values changed, checked as those of a config are.

    Everything else stays as it is in `params`, at every depth; where a leaf is an array, its new value is one of the
    same dtype. Raises ConfigError for a key that the params do not have (with the nearest one that they have), and for
    a value of the wrong type or out of its range. Args: values by dotted key, as on the command line, for example
    {"stack.planning.micro.weights.obstacle": 2.0}.
    """
    _check(params, values)
    if traced(values):
        raise ConfigError("values are traced: give numbers outside jit, or `params.replace` inside it")
    nested: dict[str, Any] = {}
    for key, given in values.items():
        value = given.item() if isinstance(given, np.ndarray | np.generic | jax.Array) and not np.ndim(given) else given
        *groups, name = key.split(".")
        place = nested
        for group in groups:
            place = place.setdefault(group, {})
            if not isinstance(place, dict):
                raise ConfigError(f"'{key}' lies within a key that has a value of its own: leave one of them out")
        if name in place:
            raise ConfigError(f"'{key}' holds keys that have values of their own: leave one of them out")
        place[name] = value
    check_keys(nested, plain(params))
    return _as_before(params, updated(params, nested))


def batched_values(params: T, values: Mapping[str, Any]) -> tuple[T, T]:
    """`params` with arrays in the place of scalars, and their `in_axes` for `jax.vmap`: 0 there, None elsewhere.

    Several arrays are zipped: value i of each makes set i. Raises ConfigError for an unknown key, a value that is no
    scalar float, one out of its range, and arrays of different lengths. Args: values [N] by dotted key, for example
    {"stack.behavior.gvp.tau": jnp.linspace(0, 1, 5)}.
    """
    _check(params, values)
    if not values:
        raise ConfigError("no values: name at least one key with an array of values")
    arrays = {key: np.asarray(array) for key, array in values.items()}
    for key, array in arrays.items():
        if array.ndim != 1 or not array.size or array.dtype.kind not in "iuf":
            raise ConfigError(f"'{key}' must be a list of numbers, one for each set, not of shape {array.shape}")
    lengths = {key: len(array) for key, array in arrays.items()}
    if len(set(lengths.values())) > 1:
        stated_lengths = ", ".join(f"'{key}' has {n}" for key, n in lengths.items())
        raise ConfigError(f"arrays that are zipped must have one length: {stated_lengths}")
    given = params
    for key, array in arrays.items():
        for value in {float(array.min()), float(array.max())} if np.all(np.isfinite(array)) else {float("nan")}:
            with_values(params, {key: value})
        leaf = _at(params, key.split("."))
        if not (isinstance(leaf, float) or getattr(leaf, "dtype", None) in (np.float32, np.float64)):
            raise ConfigError(f"'{key}' is no float: only those can be a batch, what sets shapes or choices cannot")
        dtype = getattr(leaf, "dtype", jnp.zeros(()).dtype)
        params = _replaced(params, key.split("."), jnp.asarray(array, dtype))
    return params, jax.tree.map(lambda leaf, before: None if leaf is before else 0, params, given)


def _as_before(before: Any, after: Any) -> Any:
    """`after` with arrays where `before` has them."""
    if dataclasses.is_dataclass(before) and dataclasses.is_dataclass(after):
        leaves = [spec.name for spec in stated(before) if spec.metadata.get("pytree_node", True)]
        changed = {name: _as_before(getattr(before, name), getattr(after, name)) for name in leaves}
        return dataclasses.replace(cast(Any, after), **changed)
    if isinstance(before, tuple):
        like = before[0] if before else 0.0
        return tuple(_as_before(like, value) for value in after)
    return jnp.asarray(after, before.dtype) if hasattr(before, "dtype") else after


def _at(tree: Any, path: list[str]) -> Any:
    return functools.reduce(getattr, path, tree)


def _replaced(tree: Any, path: list[str], leaf: Any) -> Any:
    name, *rest = path
    return dataclasses.replace(tree, **{name: _replaced(getattr(tree, name), rest, leaf) if rest else leaf})


def _check(params: Any, values: Any) -> None:
    if not dataclasses.is_dataclass(params) or isinstance(params, type):
        raise ConfigError(f"params is a {type(params).__name__}: give an instance of a params class")
    if not isinstance(values, Mapping) or not all(isinstance(key, str) for key in values):
        raise ConfigError('values must map dotted keys to values, like {"stack.behavior.gvp.tau": 1.0}')
