"""Road graphs of equal shape, so that one compiled program serves them all."""

import jax.numpy as jnp
from jax import Array

from urbanjax.roadmap.graph import RoadGraph
from urbanjax.types import RoadError, host_record

TABLES = {
    "n_successors": ("successor", "has_successor", "predecessor", "has_predecessor"),
    "n_relations": ("opposite", "has_opposite", "opposite_offset", "conflict", "has_conflict"),
    "n_signals_per_link": ("signal", "has_signal", "stop_line"),
}
STATIC = ("origin", "area_names", "n_signals")


@host_record
class GraphSize:
    """The shape of a road graph's arrays; None: as small as it can be."""

    n_links: int | None = None
    n_successors: int | None = None
    n_relations: int | None = None
    n_signals_per_link: int | None = None


def pad(graph: RoadGraph, size: GraphSize) -> RoadGraph:
    """The graph with more, invalid links and wider tables.

    Padding links repeat the first one, so that arithmetic on them stays well-formed; their masks are false. Raises
    RoadError where a size is below what the graph has. Args: graph; size, None where it stays as it is.
    """
    fields = {name: value for name, value in vars(graph).items() if name not in STATIC}
    for size_name, names in TABLES.items():
        for name in names:
            more = _more(size_name, getattr(size, size_name), fields[name].shape[1])
            fields[name] = jnp.pad(fields[name], ((0, 0), (0, more))) if more else fields[name]
    more = _more("n_links", size.n_links, graph.length.shape[0])
    return graph.replace(**{name: _longer(value, more) for name, value in fields.items()})


def _more(name: str, size: int | None, present: int) -> int:
    if size is not None and size < present:
        raise RoadError(f"{name} is {size}, but the network needs {present}: raise it or leave it out")
    return 0 if size is None else size - present


def _longer(x: Array, more: int) -> Array:
    if not more:  # spares a program for each shape
        return x
    row = jnp.zeros_like(x[:1]) if x.dtype == bool else x[:1]
    return jnp.concatenate([x, *([row] * more)])
