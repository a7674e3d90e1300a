"""Every safety measure of recorded or simulated traffic, and what becomes of each vehicle."""

import jax
import jax.numpy as jnp
from jax import Array

from urbanjax.numerics import safe
from urbanjax.numerics.soft import Relaxation
from urbanjax.traffic.safety.boxes import box_time_to_collision
from urbanjax.traffic.safety.encroachment import encroachments
from urbanjax.traffic.safety.exposure import time_exposed, time_integrated
from urbanjax.traffic.safety.leaders import Following, Leaders, follow, nearest_ahead
from urbanjax.traffic.safety.relative import present
from urbanjax.traffic.safety.rss import RSSParams, rss
from urbanjax.types import Objects, ScenarioError, pytree, static


@pytree
class SafetyParams:
    """Thresholds of the measures; the first two are SSAM's."""

    ttc_threshold: float = 1.5  # s, below which a time to collision is exposure
    pet_window: int = static(default=50)  # samples that a post-encroachment time is looked for, 5 s at 10 Hz
    rss: RSSParams = RSSParams()


@pytree
class Series:
    """Each vehicle at each sample."""

    leader: Leaders  # [T, V]
    following: Following  # [T, V], behind that leader
    box_ttc: Array  # [T, V] s, least over all others
    rss_margin: Array  # [T, V] m, least over all others


@pytree
class PairMeasures:
    """Each ordered pair of vehicles; the diagonal is inf, and 0 for the time."""

    box_ttc: Array  # [V, V] s, least over time; symmetric
    pet: Array  # [V, V] s, until the column comes where the row was; inf beyond the window
    rss_time: Array  # [V, V] s, during which the row is in a dangerous situation with the column


@pytree
class Summary:
    """Each vehicle over all samples; inf, or 0, for one that meets nobody or is absent."""

    min_ttc: Array  # [V] s, behind its leader
    min_headway: Array  # [V] s, behind its leader, front to front
    max_deceleration: Array  # [V] m/s^2, greatest DRAC behind its leader
    tet: Array  # [V] s, from the time to collision with its leader
    tit: Array  # [V] s^2, from the time to collision with its leader
    min_box_ttc: Array  # [V] s, with anybody
    box_tet: Array  # [V] s, from the least time to collision with anybody
    box_tit: Array  # [V] s^2, from the least time to collision with anybody
    min_pet: Array  # [V] s, with anybody, before or after it
    rss_share: Array  # [V] in [0, 1], share of its time in a dangerous situation with anybody


@pytree
class Safety:
    """All measures of T samples of V vehicles."""

    series: Series
    pairs: PairMeasures
    summary: Summary


def measure(tracks: Objects, dt: float | Array, *, params: SafetyParams, leaders: Leaders | None = None) -> Safety:
    """All measures of all ordered pairs of vehicles, and their summary per vehicle.

    At a time it holds V x V pairs of one sample, and for the PET T x V; results are [T, V] and [V, V]. Scenarios go
    through vmap. Differentiable as its parts are; TET (here hard), PET, rss_time and rss_share are piecewise constant.
    Args: tracks [T, V], box centres, absent ones with any values; dt [s] between samples; leaders, index and exists [V]
    or [T, V] (None: `nearest_ahead` at each sample). Raises ScenarioError for fields of wrong shape.
    """
    _check(tracks, leaders)
    tracks = present(tracks)
    count, n = tracks.valid.shape
    if leaders is not None:
        leaders = jax.tree.map(lambda x: jnp.broadcast_to(x, (count, n)), leaders)

    def sample(so_far: tuple[Array, Array], now: tuple[Objects, Leaders | None]) -> tuple[tuple[Array, Array], Series]:
        ttc, dangerous, series = _sample(*now, params)
        return (jnp.minimum(so_far[0], ttc), so_far[1] + dangerous.astype(jnp.int32)), series

    nothing = jnp.full((n, n), jnp.inf, tracks.speed.dtype), jnp.zeros((n, n), jnp.int32)
    (ttc, dangerous), series = jax.lax.scan(sample, nothing, (tracks, leaders))
    time = dangerous.astype(ttc.dtype) * dt
    pairs = PairMeasures(ttc, encroachments(tracks, dt, window=params.pet_window), time)
    return Safety(series, pairs, _summary(series, pairs, tracks.valid, dt, params))


def _sample(objects: Objects, leaders: Leaders | None, params: SafetyParams) -> tuple[Array, Array, Series]:
    """Time to collision and danger of all pairs [V, V], and the series [V] of one sample."""
    n = objects.valid.shape[0]
    own, other = jax.tree.map(lambda x: x[:, None], objects), jax.tree.map(lambda x: x[None], objects)
    itself = jnp.eye(n, dtype=bool)
    ttc = jnp.where(itself, jnp.inf, box_time_to_collision(own, other))
    margin = jnp.where(itself, jnp.inf, rss(own, other, params=params.rss).margin)
    leaders = nearest_ahead(objects) if leaders is None else leaders
    leader = jax.tree.map(lambda x: x[leaders.index], objects)
    leader = leader.replace(valid=leader.valid & leaders.exists)
    series = Series(leaders, follow(objects, leader), safe.minimum(ttc), safe.minimum(margin))
    return ttc, margin < 0, series


def _summary(series: Series, pairs: PairMeasures, valid: Array, dt: float | Array, params: SafetyParams) -> Summary:
    def exposure(ttc: Array) -> tuple[Array, Array]:
        limit = params.ttc_threshold
        exposed = time_exposed(ttc.T, valid.T, dt=dt, threshold=limit, relaxation=Relaxation())
        return exposed, time_integrated(ttc.T, valid.T, dt=dt, threshold=limit)

    tet, tit = exposure(series.following.ttc)
    box_tet, box_tit = exposure(series.box_ttc)
    return Summary(
        min_ttc=safe.minimum(series.following.ttc, 0),
        min_headway=safe.minimum(series.following.headway, 0),
        max_deceleration=safe.maximum(series.following.deceleration, 0),
        tet=tet,
        tit=tit,
        min_box_ttc=safe.minimum(series.box_ttc, 0),
        box_tet=box_tet,
        box_tit=box_tit,
        min_pet=jnp.min(jnp.minimum(pairs.pet, pairs.pet.T), axis=1),
        rss_share=jnp.sum(series.rss_margin < 0, axis=0) / jnp.maximum(jnp.sum(valid, axis=0), 1),
    )


def _check(tracks: Objects, leaders: Leaders | None) -> None:
    """Raise unless the fields are [T, V] (position [T, V, 2]) with at least one sample of one vehicle."""
    shape = jnp.shape(tracks.valid)
    if len(shape) != 2 or 0 in shape:
        raise ScenarioError(f"tracks.valid has the shape {shape}: give [T, V] with at least one of each (vmap batches)")
    for name in ("position", "heading", "speed", "length", "width"):
        wanted = (*shape, 2) if name == "position" else shape
        found = jnp.shape(getattr(tracks, name))
        if found != wanted:
            raise ScenarioError(f"tracks.{name} has the shape {found}: give {wanted}, as tracks.valid is {shape}")
    for name in ("index", "exists") if leaders is not None else ():
        found = jnp.shape(getattr(leaders, name))
        if found not in (shape, shape[1:]):
            raise ScenarioError(f"leaders.{name} has the shape {found}: give {shape[1:]} or {shape}")
