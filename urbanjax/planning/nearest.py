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
from urbanjax.numerics.once import once
from urbanjax.numerics.soft import Relaxation
from urbanjax.numerics.tiles import in_tiles
from urbanjax.planning.clearance import ClearanceParams, Others, Passage, gaps, gaps_to, unit_vector
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

    def some_gaps(self, index: Array) -> Array:
        """Gaps [n, C] (m) to some of them. Args: index [n, C] int, which at each point."""
        return gaps_to(boxes_among(self, index), self.driving, passage=self.passage)


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
    valued = _valued(meeting)
    return soft.minimum(valued.all_gaps(), valued.driving.relaxation, scale=valued.driving.params.gap_scale)


def _valued(meeting: Meeting) -> Meeting:
    """What the value is made of: soft where that is the mode, else hard."""
    return meeting.relaxed("soft" if meeting.driving.relaxation.mode == "soft" else "hard")


@_nearest.defjvp
def _nearest_jvp(primals: tuple[Meeting], tangents: tuple[Meeting]) -> tuple[Array, Array]:
    (meeting,), (change,) = primals, tangents
    mode = meeting.driving.relaxation.mode
    valued, relaxation, params = _valued(meeting), meeting.driving.relaxation, meeting.driving.params
    # Two loops: in one, whatever reads the gaps would have them computed anew.
    room = in_tiles(lambda passage: valued.replace(passage=passage).all_gaps(), meeting.passage, size=TILE)
    seen = in_tiles(lambda some: looked(some, relaxation, params=params), room, size=TILE)
    structure = jax.tree.structure(meeting.relaxed("hard" if mode == "hard" else "soft"))
    _, changes = jax.jvp(
        lambda leaves: jax.tree.unflatten(structure, leaves).some_gaps(seen.index),
        (jax.tree.leaves(meeting),),
        (jax.tree.leaves(change),),
    )
    by_gap = jnp.sum(seen.weight * changes, axis=1) + seen.far * change.driving.params.far
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
    near = jnp.take_along_axis(above, index, axis=1)
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


def boxes_among(meeting: Meeting, index: Int[Array, "n c"]) -> Others:
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
    share = (u - cell)[:, None, None]
    rows = index * times + cell.astype(index.dtype)[:, None]
    table = poses.reshape(count * times, 4)
    before, after = lean.rows(table, rows), lean.rows(table, rows + 1)
    x, y, cos, sin = jnp.unstack(before + share * (after - before), axis=-1)
    sizes = prediction.length / 2, prediction.width / 2
    each = jnp.stack([*sizes, prediction.speed, meeting.ignored, prediction.valid.astype(u.dtype)], axis=-1)
    half_length, half_width, speed, ignored, valid = jnp.unstack(lean.rows(each, index), axis=-1)
    box = Box(*once(x, y, *unit_vector(cos, sin), half_length, half_width))
    return Others(box, speed, valid > 0, ignored)
