"""The smallest clearance at each point of a passage, with a derivative that costs little more than its value.

A softmin over all boxes gives nearly all of its weight to the few that are nearest. Reverse mode through all pairs of
points and boxes is memory traffic: ten times the forward pass. The derivative here is that of the GRADED nearest boxes
of each point, which are looked up again by number.
"""

import jax
import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import Float, Int

from urbanjax.geometry.boxes import Box
from urbanjax.numerics import lean, soft
from urbanjax.numerics.kept import kept
from urbanjax.numerics.soft import Relaxation
from urbanjax.numerics.tiles import in_tiles
from urbanjax.planning.clearance import ClearanceParams, Ego, Others, Passage, ego_at, gaps, gaps_between, unit_vector
from urbanjax.planning.least import least_gap
from urbanjax.types import Prediction, pytree
from urbanjax.vehicle.driving import Driving

GRADED = 4  # boxes at each point that a derivative reaches
TILE = 246  # points looked at together
LIFT = 256.0  # m, added to gaps so that their bits are ordered as they are; smaller ones than its negative are that


@pytree
class Meeting:
    """What the clearance of a passage depends on."""

    passage: Passage
    driving: Driving  # with ClearanceParams
    prediction: Prediction
    ignored: Array  # [B] degree to which an object does not count

    def relaxed(self, mode: str) -> "Meeting":
        """The same in a mode of relaxation."""
        relaxation = self.driving.relaxation.replace(mode=mode)
        return self.replace(driving=self.driving.replace(relaxation=relaxation))

    def all_gaps(self) -> Array:
        """Gaps [n, B] (m) to all boxes."""
        return gaps(self.passage, self.driving, prediction=self.prediction, ignored=self.ignored)

    def pairs(self, index: Array) -> tuple["Pairs", "Fixed"]:
        """The ego and some of the boxes at each point. Args: index [n, C] int, which."""
        boxes, fixed = boxes_among(self, index)
        count = index.shape[0]
        ego = jax.tree.map(lambda x: jnp.broadcast_to(x, (count, 1)), ego_at(self.passage, self.driving))
        return boxes.replace(ego=ego), fixed


def nearest(
    passage: Passage, driving: Driving, *, prediction: Prediction, ignored: Float[Array, "b"]
) -> Float[Array, "n"]:
    """Smallest gap [n] (m) at each point to any predicted box, as the relaxation has it; see `clearance.gaps`.

    Differentiable in both modes of differentiation; a box that is d farther than the nearest one and not among the
    GRADED nearest is left out of the derivative, where its weight would be exp(-d / T). Args: passage, of the ego;
    driving, with ClearanceParams; prediction, of everybody else; ignored [B], degree to which an object does not count.
    """
    return _nearest(Meeting(passage, driving, prediction, ignored))


@jax.custom_jvp
def _nearest(meeting: Meeting) -> Array:
    relaxation, params = meeting.driving.relaxation, meeting.driving.params
    if relaxation.mode != "soft":
        return least_gap(meeting.passage, meeting.driving, prediction=meeting.prediction, ignored=meeting.ignored)
    return soft.minimum(meeting.all_gaps(), relaxation, scale=params.gap_scale)


def _valued(meeting: Meeting) -> Meeting:
    """What the value is made of: soft where that is the mode, else hard."""
    return meeting.relaxed("soft" if meeting.driving.relaxation.mode == "soft" else "hard")


@_nearest.defjvp
def _nearest_jvp(primals: tuple[Meeting], tangents: tuple[Meeting]) -> tuple[Array, Array]:
    (meeting,), (change,) = primals, tangents
    mode = meeting.driving.relaxation.mode
    valued, relaxation, params = _valued(meeting), meeting.driving.relaxation, meeting.driving.params
    # As one array: within the loop, whatever reads the gaps would have them computed anew.
    room = valued.all_gaps()
    seen = kept(in_tiles(lambda some: looked(some, relaxation, params=params), room, size=TILE))
    pairs, moved, fixed = jax.jvp(
        lambda leaves: jax.tree.unflatten(jax.tree.structure(meeting), leaves).pairs(seen.index),
        (jax.tree.leaves(meeting),),
        (jax.tree.leaves(change),),
        has_aux=True,
    )
    smooth = "hard" if mode == "hard" else "soft"
    sloped = (pairs, fixed, seen.weight)
    slopes = in_tiles(lambda rows: slopes_of(*rows[:2], weight=rows[2], mode=smooth), sloped, size=TILE)
    by_gap = seen.far * change.driving.params.far + sum(
        jnp.sum((slope * along).reshape(slope.shape[0], -1), axis=1)
        for slope, along in zip(jax.tree.leaves(slopes), jax.tree.leaves(moved), strict=True)
    )
    if mode == "hard":
        return seen.value, by_gap
    changed = change.driving
    warmer = changed.relaxation.temperature * params.gap_scale + relaxation.temperature * changed.params.gap_scale
    return seen.value, by_gap + seen.by_temperature * warmer


@pytree
class Looked:
    """The smallest gap at n points, and what its derivative is made of."""

    value: Array  # [n] m
    index: Array  # [n, C] int, boxes that it depends on
    weight: Array  # [n, C] derivative by their gaps
    far: Array  # [n] derivative by the distance beyond which nothing counts, through all other boxes
    by_temperature: Array  # [n] derivative of the softmin by its temperature, gaps held


def looked(room: Float[Array, "n b"], relaxation: Relaxation, *, params: ClearanceParams) -> Looked:
    """What the gaps to all boxes tell. Args: room [n, B] m; relaxation, of the smallest; params."""
    least = jnp.min(room, axis=1)
    if relaxation.mode == "hard":
        index, none = jnp.argmin(room, axis=1)[:, None], jnp.zeros_like(least)
        return Looked(least, index, jnp.ones_like(least)[:, None], none, none)
    index = smallest(room, min(GRADED, room.shape[1]))
    temperature = relaxation.temperature * params.gap_scale
    above = (room - least[:, None]) / temperature
    shares = jnp.exp(-above)
    total = jnp.sum(shares, axis=1)
    near = (jnp.take_along_axis(room, index, axis=1) - least[:, None]) / temperature
    weight = jnp.exp(-near) / total[:, None]
    # Those that are as far as anything counts move with that distance alone, however many there are.
    beyond = near * temperature + least[:, None] >= params.far
    far = jnp.sum(jnp.where(room >= params.far, shares, 0), axis=1) / total
    return Looked(
        value=least - temperature * jnp.log(total) if relaxation.mode == "soft" else least,
        index=index,
        weight=weight,
        far=far - jnp.sum(jnp.where(beyond, weight, 0), axis=1),
        by_temperature=-jnp.log(total) - jnp.sum(shares * above, axis=1) / total,
    )


def smallest(gap: Float[Array, "n b"], count: int) -> Int[Array, "n c"]:
    """Where the smallest entries of each row are, to a millimetre. Args: gap [n, B] m; count C, how many."""
    bits = max(1, (gap.shape[1] - 1).bit_length())
    lifted = lean.maximum(lax.stop_gradient(gap).astype(jnp.float32), 1 - LIFT) + LIFT
    number = jnp.arange(gap.shape[1], dtype=jnp.int32)
    # The last bits of the gap make room for the number: the least of them tells both.
    key = (lax.bitcast_convert_type(lifted, jnp.int32) & ~(2**bits - 1)) | number[None, :]
    found = []
    for _ in range(count):
        least = jnp.min(key, axis=1)
        found.append(least & (2**bits - 1))
        key = jnp.where(key == least[:, None], jnp.iinfo(jnp.int32).max, key)
    return jnp.stack(found, axis=1)


@pytree
class Pairs:
    """The ego at each of n points and C boxes there, as far as gaps between them have derivatives."""

    pose: Array  # [n, C, 4] x, y (m), cosine and sine of the heading, not yet a unit vector
    each: Array  # [n, C, 4] half length, half width (m), speed (m/s), degree to which it does not count
    share: Array  # [n, 1] of the way between two predicted times
    ego: Ego | None = None  # [n, 1]


@pytree
class Fixed:
    """What gaps depend on besides, without a derivative."""

    rate: Array  # [n, C, 4] change of the pose by the share
    valid: Array  # [n, C] bool


def boxes_among(meeting: Meeting, index: Int[Array, "n c"]) -> tuple[Pairs, Fixed]:
    """C of the predicted boxes at each point, when it is passed.

    They are `clearance.predicted_boxes`, read at the two predicted times on either side. Args: meeting; index [n, C]
    int, which at each point.
    """
    prediction, passage = meeting.prediction, meeting.passage
    count, times = prediction.heading.shape
    local = prediction.position - passage.position[0][None, None, :]
    poses = jnp.concatenate([local, *(f(prediction.heading)[..., None] for f in (jnp.cos, jnp.sin))], axis=-1)
    u = lean.maximum((passage.time - prediction.time[0]) / (prediction.time[1] - prediction.time[0]), 0.0)
    cell = lean.minimum(jnp.floor(lax.stop_gradient(u)), times - 2)
    share = u - cell
    rows = index * times + cell.astype(index.dtype)[:, None]
    table = poses.reshape(count * times, 4)
    before, after = lean.rows(table, rows), lean.rows(table, rows + 1)
    # The share moves the pose by its rate, which `slopes_of` knows: so what is kept for the derivative is small.
    pose = before + lax.stop_gradient(share)[:, None, None] * (after - before)
    sizes = prediction.length / 2, prediction.width / 2
    each = lean.rows(jnp.stack([*sizes, prediction.speed, meeting.ignored], axis=-1), index)
    rate, valid = lax.stop_gradient(after - before), lean.rows(prediction.valid.astype(jnp.int32), index) > 0
    return Pairs(pose, each, share[:, None]), Fixed(rate, valid)


def slopes_of(pairs: Pairs, fixed: Fixed, *, weight: Float[Array, "n c"], mode: str) -> Pairs:
    """Derivative of the weighted sum of the gaps at each point by what belongs to that point.

    A sum over all points has each of these derivatives in its gradient, since no point depends on another. Args: pairs;
    fixed; weight [n, C], of the gaps; mode, of relaxation.
    """

    def total(pairs: Pairs) -> Array:
        # Points last: the compiler makes vectors of the innermost axis.
        pose = jnp.transpose(pairs.pose + (pairs.share - lax.stop_gradient(pairs.share))[..., None] * fixed.rate)
        half_length, half_width, speed, ignored = jnp.transpose(pairs.each)
        x, y, cos, sin = pose
        cos, sin = unit_vector(cos, sin)
        others = Others(Box(x, y, cos, sin, half_length, half_width), speed, fixed.valid.T, ignored)
        ego = jax.tree.map(jnp.transpose, pairs.ego)
        return jnp.sum(weight.T * gaps_between(ego, others, mode=mode))

    return jax.grad(total)(pairs)
