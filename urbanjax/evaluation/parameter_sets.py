"""Parameter sets that one program drives: alike in all but the values of their leaves (host side)."""

import dataclasses
from collections.abc import Collection, Hashable, Sequence
from typing import Any

import jax
import numpy as np

from urbanjax.evaluation.traffic import mannered_sim
from urbanjax.rollout import LoopParams
from urbanjax.types import ConfigError, as_arrays, host_record


@host_record
class ParameterSets:
    """S closed loops of one structure and one period."""

    each: tuple[LoopParams, ...]
    stacked: LoopParams  # [S]

    @property
    def period(self) -> float:
        """Of a step [s], in all of them."""
        return float(self.each[0].period)

    def at(self, numbers: Sequence[int]) -> LoopParams:
        """Those of C places, [C]. Args: numbers, the set of each place."""
        chosen = np.asarray(numbers)
        return jax.device_put(jax.tree.map(lambda x: x[chosen], self.stacked))

    def with_driver(self, driver: Any) -> "ParameterSets":
        """The same with another driver in all. Args: driver, see `drivers.protocol`."""
        return _stacked([loop.replace(driver=as_arrays(driver)) for loop in self.each])


def parameter_sets(
    loop: LoopParams | Sequence[LoopParams], *, traffic: str, asked: Collection[int] = ()
) -> ParameterSets:
    """One set or several, for traffic of a kind.

    Args: loop, or loops; traffic, how the others drive; asked, numbers of sets. Raises ConfigError where there is none,
    where they differ in what one program cannot hold (structure, static fields, shapes, dtypes, the period), and for a
    number that none of them has.
    """
    loops = [loop] if isinstance(loop, LoopParams) else list(loop)
    if not loops:
        raise ConfigError("there is no parameter set: give LoopParams, or several of them")
    loops = [_among(one, traffic) for one in loops]
    for number, one in enumerate(loops):
        key = _first_difference(loops[0], one) or ("period" if one.period != loops[0].period else "")
        if key:
            raise ConfigError(
                f"parameter set {number} differs from set 0 in '{key}', which is part of the program: make it the same "
                "in all, or evaluate these sets one after the other"
            )
    for number in set(asked).difference(range(len(loops))):
        raise ConfigError(f"there is no parameter set {number}: give jobs a number from 0 to {len(loops) - 1}")
    return _stacked(loops)


def form_of(loop: LoopParams, *, traffic: str) -> Hashable:
    """What loops have to share for one program to drive them. Args: loop; traffic, how the others drive."""
    return *_form(_among(loop, traffic)), float(loop.period)


def _among(loop: LoopParams, traffic: str) -> LoopParams:
    """The loop alone, as arrays, among traffic of a kind."""
    return as_arrays(loop.loop().replace(sim=mannered_sim(loop.sim, traffic)))


def _first_difference(one: Any, other: Any) -> str:
    """The dotted key of the first field by which two trees need two programs; none where one program holds both."""
    for spec in dataclasses.fields(one) if dataclasses.is_dataclass(one) and type(one) is type(other) else ():
        mine, theirs = getattr(one, spec.name), getattr(other, spec.name)
        leaf = spec.metadata.get("pytree_node", True)
        if (_form(mine) != _form(theirs)) if leaf else mine != theirs:
            return f"{spec.name}.{_first_difference(mine, theirs)}".rstrip(".") if leaf else spec.name
    return ""


def _form(tree: Any) -> tuple:
    """What a compiled program depends on."""
    leaves, structure = jax.tree.flatten(tree)
    return structure, tuple((leaf.shape, leaf.dtype) for leaf in leaves)


def _stacked(loops: Sequence[LoopParams]) -> ParameterSets:
    return ParameterSets(tuple(loops), jax.tree.map(lambda *x: np.stack(x), *jax.device_get(list(loops))))
