"""The one decorator for every record of the stack: an immutable pytree."""

from typing import Any, TypeVar, dataclass_transform, no_type_check

import flax.struct
import jax
import jax.numpy as jnp

T = TypeVar("T")

field = flax.struct.field


def static(**kwargs: Any) -> Any:
    """A field that is part of the pytree's structure (sizes, modes): changing it compiles anew.

    Args: kwargs of a flax field, such as its default.
    """
    return flax.struct.field(pytree_node=False, **kwargs)


# Of a field that whoever holds the params fills in: None until then, and no key of a config. What several parts have to
# agree on (the vehicle, the period, where a sensor is mounted) is said once, above them.
HANDED_DOWN = {"handed_down": True}


@dataclass_transform(field_specifiers=(flax.struct.field, static))
def pytree(cls: type[T]) -> type[T]:
    """A frozen dataclass that is a pytree and has `.replace(**changes)`.

    Its fields are exempt from run-time type checks, because under jit, vmap, grad and scan they hold tracers,
    batched arrays or placeholders. Shapes are stated in comments beside the fields.
    Args: cls, a class with annotated fields.
    """
    return no_type_check(flax.struct.dataclass(cls))


def as_arrays(tree: T, dtype: Any = None) -> T:
    """`tree` with every Python or array float cast to one strong float dtype.

    Called once at the edge, so that a weakly typed Python float never compiles a second program.
    Args: tree, any pytree; dtype, float dtype (default: the current default float).
    """
    dtype = jnp.zeros(()).dtype if dtype is None else dtype

    def cast(leaf: Any) -> Any:
        is_float = isinstance(leaf, float) or (hasattr(leaf, "dtype") and jnp.issubdtype(leaf.dtype, jnp.floating))
        return jnp.asarray(leaf, dtype) if is_float else jnp.asarray(leaf)

    return jax.tree.map(cast, tree)
