"""The one decorator for every record of the stack: an immutable pytree."""

import dataclasses
import functools
import operator
from collections.abc import Callable
from typing import Any, TypeVar, dataclass_transform, no_type_check

import jax
import jax.numpy as jnp

from urbanjax.types import limits
from urbanjax.types.arguments import short
from urbanjax.types.errors import ConfigError
from urbanjax.types.fields_doc import FieldsDoc

T = TypeVar("T")


def field(**kwargs: Any) -> Any:
    """A field that is a leaf or holds leaves, with more to say than a default. Args: kwargs of a dataclass' field."""
    return dataclasses.field(**kwargs)


def static(*, metadata: dict[str, Any] | None = None, **kwargs: Any) -> Any:
    """A field that is part of the pytree's structure (sizes, modes): changing it compiles anew.

    Args: metadata, such as its choices; kwargs of a dataclass' field, such as its default.
    """
    return dataclasses.field(metadata={**(metadata or {}), "pytree_node": False}, **kwargs)


# Of a field that whoever holds the params fills in: None until then, and no key of a config. What several parts have to
# agree on (the vehicle, the period, where a sensor is mounted) is said once, above them.
HANDED_DOWN = {"handed_down": True}


@dataclass_transform(field_specifiers=(field, static))
def pytree(cls: type[T]) -> type[T]:
    """A frozen dataclass that is a pytree and has `.replace(**changes)`.

    What a field states of its values (metadata `choices` and `range`, see `types.limits`) is checked when one is made
    or replaced. JAX puts a tree together around that: its leaves may be tracers, axes, gradients or placeholders.
    For the same reason fields are exempt from run-time type checks; shapes are stated in comments beside them, which
    `help()` shows.
    Args: cls, a class with annotated fields.
    """
    made: Any = dataclasses.dataclass(frozen=True)(cls)
    made.replace = dataclasses.replace
    made.__doc__ = FieldsDoc(made.__doc__)
    stated = limits.stated_limits(made)
    if stated:
        made.__init__ = _checked(made.__init__, stated)
    _register(made)
    return no_type_check(made)


@dataclass_transform(frozen_default=True)
def host_record(cls: type[T]) -> type[T]:
    """A frozen dataclass of what stays on the host: files as read, tables, worlds to drive in. `help()` as above.

    Args: cls, a class with annotated fields.
    """
    made: Any = dataclasses.dataclass(frozen=True)(cls)
    made.__doc__ = FieldsDoc(made.__doc__)
    return no_type_check(made)


def _checked(init: Callable[..., None], stated: list[limits.FieldLimits]) -> Callable[..., None]:
    @functools.wraps(init)
    def checked_init(self: Any, *args: Any, **kwargs: Any) -> None:
        init(self, *args, **kwargs)
        limits.check(self, stated)

    return checked_init


def _register(made: type) -> None:
    """Tell JAX which fields are leaves, and how to make one from them without its constructor."""
    specs = dataclasses.fields(made)
    leaves = tuple(spec.name for spec in specs if spec.metadata.get("pytree_node", True))
    rest = tuple(spec.name for spec in specs if spec.name not in leaves)
    keys = [jax.tree_util.GetAttrKey(name) for name in leaves]
    children, structure, new = _reader(leaves), _reader(rest), object.__new__

    def flatten(record: Any) -> tuple[tuple, tuple]:
        return children(record), structure(record)

    def flatten_with_keys(record: Any) -> tuple[tuple, tuple]:
        return tuple(zip(keys, children(record), strict=True)), structure(record)

    def unflatten(held: tuple, values: Any) -> Any:
        record = new(made)
        names = record.__dict__
        names.update(zip(leaves, values))  # noqa: B905, here and below: JAX counts them, and this is a hot path
        names.update(zip(rest, held))  # noqa: B905
        return record

    jax.tree_util.register_pytree_with_keys(made, flatten_with_keys, unflatten, flatten)


def _reader(names: tuple[str, ...]) -> Callable[[Any], tuple]:
    """A function that takes these attributes of an object, as a tuple."""
    if len(names) > 1:
        return operator.attrgetter(*names)
    return (lambda record: (getattr(record, names[0]),)) if names else (lambda record: ())


def as_arrays(tree: T, dtype: Any = None) -> T:
    """`tree` with every Python or array float cast to one strong float dtype.

    Called once at the edge, so that a weakly typed Python float never compiles a second program.
    Args: tree, any pytree; dtype, float dtype (default: the current default float). Raises ConfigError for a leaf that
    is no number and a dtype that is none of floats.
    """
    dtype = jnp.zeros(()).dtype if dtype is None else _float_dtype(dtype)

    def cast(leaf: Any) -> Any:
        if isinstance(leaf, str | bytes) or getattr(getattr(leaf, "dtype", None), "kind", "f") in "OUS":
            raise ConfigError(f"tree holds {short(leaf)}, which is no number: give params, or arrays")
        is_float = isinstance(leaf, float) or (hasattr(leaf, "dtype") and jnp.issubdtype(leaf.dtype, jnp.floating))
        return jnp.asarray(leaf, dtype) if is_float else jnp.asarray(leaf)

    try:
        return jax.tree.map(cast, tree)
    except TypeError as error:
        raise ConfigError(f"tree is a {type(tree).__name__} with leaves that are no numbers: give params") from error


def _float_dtype(dtype: Any) -> Any:
    try:
        known = jnp.dtype(dtype)
    except TypeError:
        known = jnp.dtype(int)
    if not jnp.issubdtype(known, jnp.floating):
        raise ConfigError(f"dtype is {short(dtype)}: give one of floats, such as jnp.float32, for no float is cut off")
    return known
