"""Which lane a pose is on: the only place that finds a lane."""

import functools
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Int

from urbanjax.numerics import lean, safe
from urbanjax.roadmap.graph import RoadGraph
from urbanjax.roadmap.links import project
from urbanjax.types import RoadError, pytree, static

TINY = 1e-6  # m^2, keeps chords of length 0 from dividing by 0
FAR = 1e6  # m, the distance of a link that does not count


@pytree
class LocateParams:
    """What counts against a lane, as metres added to its distance, and how far one is looked for."""

    PINNED: ClassVar[dict[str, str]] = {
        "*": "fact: which lane somebody is on is so or not so, whatever the ego would like",
    }

    max_distance: float = 5.0  # m from the centre line, beyond which a pose is on no lane
    heading_gate: float = 1.05  # rad, heading error beyond which a lane is taken only if no other is near
    heading_penalty: float = 20.0  # m, for a lane beyond the gate
    heading_weight: float = 1.0  # m per squared rad, tells apart the lanes of a fork
    connectivity_penalty: float = 3.0  # m, for a lane not connected to the previous one
    hysteresis: float = 0.5  # m, for a lane other than the previous one and its successors
    candidates: int = static(default=6)  # k, lanes looked at closely
    chords: int = static(default=4)  # per link, for the coarse search


@pytree
class Location:
    """Poses related to the lanes that they are on."""

    link: Array  # [N] int32
    station: Array  # [N] m along the link, within its ends
    offset: Array  # [N] m from the centre line, left positive
    heading_error: Array  # [N] rad in [-pi, pi), of the pose against the lane
    distance: Array  # [N] m from the centre line (more than |offset| beyond the ends of the link)
    valid: Array  # [N] bool


def locate(
    graph: RoadGraph,
    position: Float[Array, "n 2"],
    *,
    heading: Float[Array, "n"],
    previous: Location | None = None,
    params: LocateParams | None = None,
) -> Location:
    """The lane of each pose (corrects the nearest link of Eq. 26, which flips at crossings).

    Nearest centre line, with a heading gate; with `previous` (of the same poses a step earlier), lanes connected to the
    previous one are preferred, and that one itself is kept until another is clearly nearer. A hard choice: `link` is
    not differentiable and jumps between lanes; station, offset and heading error are differentiable in the pose on
    the chosen lane. Coarse to fine: distance to a few chords of every link, then exact projection on the best k.
    Args: graph, the road graph; position [N, 2] m; heading [N] rad; previous, the locations a step earlier (None:
    nothing is known).
    """
    params = LocateParams() if params is None else params
    penalty = _penalty(graph, previous, params, position)
    rough = _coarse(graph, position, heading, params) + penalty
    links = jax.lax.top_k(-rough, min(params.candidates, rough.shape[1]))[1]
    station, distance, angle = jax.lax.stop_gradient(_nearest(graph, links, position))
    cost = distance + _heading_cost(safe.wrap_angle(heading[:, None] - angle), params)
    cost = cost + jnp.take_along_axis(penalty, links, axis=1)
    best = lean.argmin(jnp.where(graph.valid[links], cost, FAR))[:, None]
    link, guess = (jnp.take_along_axis(x, best, axis=1)[:, 0] for x in (links, station))
    at = project(graph, link, guess=guess, position=position)
    valid = graph.valid[link] & (at.distance < params.max_distance)
    return Location(link, at.station, at.offset, safe.wrap_angle(heading - at.heading), at.distance, valid)


@pytree
class Onwards:
    """Where one can be a moment later, for each of L links: E of them, of which the second and third lie beside."""

    link: Array  # [L, E] int32
    exists: Array  # [L, E] bool


def onwards(graph: RoadGraph, size: int | None = None) -> Onwards:
    """This link, its neighbours, its successors, and the other ways of the fork that it is one of (host side).

    Those lie on each other at first, so that the one taken shows only later. Raises RoadError where there are more
    than `size`. Args: graph, the road graph; size, E (None: as few as it can be).
    """
    left, right, has_left, has_right = (
        np.asarray(x) for x in (graph.left_link, graph.right_link, graph.has_left, graph.has_right)
    )
    successor, has = np.asarray(graph.successor), np.asarray(graph.has_successor)
    following = [successor[k][has[k]].tolist() for k in range(len(successor))]
    forks: dict[int, list[int]] = {}
    for ways in following:
        for link in ways:
            forks[link] = forks.get(link, []) + ways
    rows = []
    for k, ways in enumerate(following):
        beside = ({int(left[k])} if has_left[k] else set()) | ({int(right[k])} if has_right[k] else set())
        more = dict.fromkeys([*ways, *forks.get(k, [])])
        rows.append([link for link in more if link != k and link not in beside])
    longest = 3 + max(map(len, rows))
    if size is not None and longest > size:
        raise RoadError(f"from one link {longest} can be reached at once, more than {size}: raise the number")
    table = np.zeros((len(rows), size or longest), np.int32)
    exists = np.zeros(table.shape, bool)
    table[:, 0], table[:, 1], table[:, 2] = np.arange(len(rows)), left, right
    exists[:, 0], exists[:, 1], exists[:, 2] = True, has_left, has_right
    for k, row in enumerate(rows):
        table[k, 3 : 3 + len(row)], exists[k, 3 : 3 + len(row)] = row, True
    return Onwards(jnp.asarray(table), jnp.asarray(exists))


def follow(
    graph: RoadGraph,
    previous: Int[Array, ""],
    *,
    ways: Onwards,
    position: Float[Array, "2"],
    heading: Float[Array, ""],
    params: LocateParams,
) -> Int[Array, ""]:
    """The link of one pose that was on `previous` a moment ago: one of its row in `ways`.

    As `locate`, but for a pose that cannot have got anywhere else: no link farther away is looked at.
    Args: graph, the road graph; previous, a link; ways, from each link; position [2] m; heading [] rad.
    """
    links, exists = ways.link[previous], ways.exists[previous]
    _, distance, angle = _nearest(graph, links[None], position[None])
    cost = distance + _heading_cost(safe.wrap_angle(heading - angle), params)
    aside = jnp.zeros(len(links), bool).at[1:3].set(True)  # the second and third of `links`
    cost = cost[0] + jnp.where(aside, params.hysteresis, 0.0)
    return links[lean.argmin(jnp.where(exists, cost, FAR))].astype(jnp.int32)


def misfit(
    graph: RoadGraph, position: Float[Array, "n 2"], *, heading: Float[Array, "n"], params: LocateParams
) -> Float[Array, "n l"]:
    """How badly each pose fits each link [m]: its distance, and what its heading costs; FAR for padding.

    What `locate` chooses by, without continuity: for those who choose among whole sequences of links.
    Args: graph, the road graph; position [N, 2] m; heading [N] rad.
    """
    links = jnp.broadcast_to(jnp.arange(graph.length.shape[0]), (position.shape[0], graph.length.shape[0]))
    _, distance, angle = _nearest(graph, links, position)
    cost = distance + _heading_cost(safe.wrap_angle(heading[:, None] - angle), params)
    return jnp.where(graph.valid[None, :], cost, FAR)


def _heading_cost(error: Array, params: LocateParams) -> Array:
    return jnp.where(jnp.abs(error) > params.heading_gate, params.heading_penalty, 0) + params.heading_weight * error**2


def _penalty(graph: RoadGraph, previous: Location | None, params: LocateParams, position: Array) -> Float[Array, "n l"]:
    """What continuity adds [m] to the distance of each link."""
    n_links = graph.length.shape[0]
    if previous is None:
        return jnp.zeros((position.shape[0], n_links), position.dtype)
    each = jnp.arange(n_links)[None, :]
    link = previous.link

    def among(table: Array, mask: Array) -> Bool[Array, "n l"]:
        """Whether each link is in the row [N, m] of the table."""
        return jnp.any((table[:, :, None] == each[:, None, :]) & mask[:, :, None], axis=1)

    ahead = among(graph.successor[link], graph.has_successor[link]) | (each == link[:, None])
    sides = jnp.stack([graph.left_link[link], graph.right_link[link]], axis=1)
    has = jnp.stack([graph.has_left[link], graph.has_right[link]], axis=1)
    beyond = graph.successor[sides].reshape(len(link), -1)
    has_beyond = (graph.has_successor[sides] & has[:, :, None]).reshape(len(link), -1)
    connected = ahead | among(sides, has) | among(beyond, has_beyond)
    cost = jnp.where(connected, 0, params.connectivity_penalty) + jnp.where(ahead, 0, params.hysteresis)
    return jnp.where(previous.valid[:, None], cost, 0).astype(position.dtype)


def _coarse(graph: RoadGraph, position: Array, heading: Array, params: LocateParams) -> Float[Array, "n l"]:
    """Distance [m] to the chords of each link, with the heading's cost; large for links that do not count."""
    last = graph.centre.shape[1] - 1
    corner = graph.centre[:, jnp.array([round(last * k / params.chords) for k in range(params.chords + 1)])]
    (x, y), (cos, sin) = position.T[..., None], jnp.stack([jnp.cos(heading), jnp.sin(heading)])[..., None]

    def to_chord(k: int) -> Array:
        """Distance to a chord of each link, and what the heading costs there."""
        (start_x, start_y), (dx, dy) = corner[:, k].T, (corner[:, k + 1] - corner[:, k]).T
        size = jnp.maximum(dx * dx + dy * dy, TINY)
        along, aside = dx / jnp.sqrt(size), dy / jnp.sqrt(size)
        turned = cos * along[None] + sin * aside[None]
        to_x, to_y = x - start_x[None], y - start_y[None]
        t = lean.clip((to_x * dx[None] + to_y * dy[None]) / size[None], 0.0, 1.0)
        distance = jnp.sqrt((to_x - t * dx[None]) ** 2 + (to_y - t * dy[None]) ** 2)
        against = jnp.where(turned < jnp.cos(params.heading_gate), params.heading_penalty, 0)
        return distance + against + 2 * params.heading_weight * (1 - turned)

    # Chord by chord: with an axis of few entries at the end of the arrays it would take many times as long.
    cost = functools.reduce(jnp.minimum, (to_chord(k) for k in range(params.chords)))
    return jax.lax.stop_gradient(jnp.where(graph.valid[None], cost, FAR))


def _nearest(graph: RoadGraph, links: Int[Array, "n k"], position: Array) -> tuple[Array, Array, Array]:
    """Station [m], distance [m] and heading [rad] of the nearest place on the polyline of each link, [N, k]."""
    x, y = jnp.unstack(lean.rows(graph.centre, links), axis=-1)
    dx, dy = x[..., 1:] - x[..., :-1], y[..., 1:] - y[..., :-1]
    to_x, to_y = position[:, None, None, 0] - x[..., :-1], position[:, None, None, 1] - y[..., :-1]
    t = jnp.clip((to_x * dx + to_y * dy) / jnp.maximum(dx * dx + dy * dy, TINY), 0, 1)
    square = (to_x - t * dx) ** 2 + (to_y - t * dy) ** 2
    segment = lean.argmin(square)
    t, square = (jnp.take_along_axis(each, segment[..., None], axis=-1)[..., 0] for each in (t, square))
    n_points = x.shape[-1]
    angle, first = graph.heading.reshape(-1), links * n_points + segment
    heading = lean.rows(angle, first) * (1 - t) + lean.rows(angle, first + 1) * t
    station = (segment.astype(t.dtype) + t) * lean.rows(graph.length, links) / (n_points - 1)
    return station, jnp.sqrt(square), heading
