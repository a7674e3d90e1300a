"""Learned costs on disk, plain arrays by name; nothing in them is ever executed."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np

from urbanjax.io.runs.checkpoints import read_checkpoint, write_checkpoint
from urbanjax.planning.learned import CONTEXT, LearnedCost
from urbanjax.planning.micro import MICRO_TERMS
from urbanjax.types import FileError

LAYERS = 3


def save_learned(path: Path, learned: LearnedCost) -> None:
    """Write a learned cost. Args: path of the file; learned. Raises FileError where it cannot be written."""
    arrays = {"size": np.asarray(learned.size, np.float32)}
    for i, (kernel, bias) in enumerate(zip(learned.kernel, learned.bias, strict=True)):
        arrays |= {f"kernel_{i}": np.asarray(kernel, np.float32), f"bias_{i}": np.asarray(bias, np.float32)}
    write_checkpoint(Path(path), arrays, about={"holds": "learned cost"})


def load_learned(path: Path) -> LearnedCost:
    """A learned cost as it was saved.

    Args: path of the file. Raises FileError where it is missing, no such file, or of other terms than the planner has.
    """
    arrays, _ = read_checkpoint(Path(path))
    names = {"size", *(f"{kind}_{i}" for kind in ("kernel", "bias") for i in range(LAYERS))}
    if set(arrays) != names:
        raise FileError(f"{path}: has not the arrays of a learned cost: save one with `save_learned`")
    hidden = arrays["kernel_0"].shape[-1]
    widths = (len(MICRO_TERMS) + len(CONTEXT), hidden, hidden, 1)
    shapes = {"size": (len(MICRO_TERMS),)}
    for i in range(LAYERS):
        shapes |= {f"kernel_{i}": widths[i : i + 2], f"bias_{i}": widths[i + 1 : i + 2]}
    for name, shape in shapes.items():
        if arrays[name].shape != shape or arrays[name].dtype != np.float32 or not np.isfinite(arrays[name]).all():
            raise FileError(f"{path}: {name!r} must hold finite float32 numbers of shape {shape}: train it anew")
    return LearnedCost(
        kernel=tuple(jnp.asarray(arrays[f"kernel_{i}"]) for i in range(LAYERS)),
        bias=tuple(jnp.asarray(arrays[f"bias_{i}"]) for i in range(LAYERS)),
        size=jnp.asarray(arrays["size"]),
    )
