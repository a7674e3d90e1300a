"""What the backward pass through a loop of steps keeps of each of them, where all else is computed anew."""

from collections.abc import Callable
from typing import Any, TypeVar

import jax
from jax.ad_checkpoint import checkpoint_name

T = TypeVar("T")

NAME = "kept"


def kept(values: T) -> T:
    """The values, marked: they cost much to compute and take little room.

    Only what is made of the marked values spares their computation: mark them at once, and in a derivative by hand,
    since what automatic differentiation notes of an operation is its result before the mark. Args: values, a pytree of
    arrays.
    """
    return checkpoint_name(values, NAME)


def recomputed(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, of which the backward pass has the arguments and what is `kept`.

    Args: function, the body of a scan, or part of one.
    """
    return jax.checkpoint(function, prevent_cse=False, policy=jax.checkpoint_policies.save_only_these_names(NAME))
