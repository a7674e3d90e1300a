"""Platoons: does a disturbance grow from vehicle to vehicle, how close do they drive, how much traffic is that."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from experiments.traffic.study import PlatoonStudy
from urbanjax.io.logs import LogError, VehicleLog
from urbanjax.io.logs.quality import stuck
from urbanjax.io.logs.resample import by_time
from urbanjax.numerics.soft import Relaxation
from urbanjax.traffic.flow import edie, stability, transfer
from urbanjax.traffic.flow.transfer import Transfer
from urbanjax.traffic.safety.exposure import time_exposed, time_integrated
from urbanjax.traffic.safety.following import required_deceleration, time_gap, time_to_collision
from urbanjax.types import as_arrays, host_record

_gains, _transfer = jax.jit(stability.gains), jax.jit(transfer.transfer, static_argnames="length")
_intervals = jax.jit(stability.bootstrapped, static_argnames=("block", "draws"))
_diagram = jax.jit(edie.diagram)


@host_record
class Gain:
    """Head to tail, over one stretch of time."""

    start: float  # s
    end: float  # s
    ratio: float  # of the standard deviations of speed
    low: float
    high: float
    peaks: float  # ratio of the greatest deviations


@host_record
class Platoon:
    """One recording of V vehicles in the order they drive in, and what was measured."""

    name: str
    vehicles: list[str]
    time: np.ndarray  # [T] s
    speed: np.ndarray  # [V, T] m/s
    gap: np.ndarray  # [V, T] m to the rear of the vehicle ahead, inf for the first
    valid: np.ndarray  # [V, T] bool
    spread: np.ndarray  # [V] m/s, standard deviation of speed
    whole: Gain
    moving: Gain | None  # while all drive
    spectra: Transfer
    headway: np.ndarray  # [V, T] s, gap over speed; this and what follows inf, or 0, unless all drive
    ttc: np.ndarray  # [V, T] s
    deceleration: np.ndarray  # [V, T] m/s^2, DRAC
    exposed: np.ndarray  # [V] s, TET below 1.5 s
    integrated: np.ndarray  # [V] s^2
    flow: np.ndarray  # [cells] vehicles/h
    density: np.ndarray  # [cells] vehicles/km


def platoons(found: list[VehicleLog], study: PlatoonStudy, threshold: float, seed: int) -> list[Platoon]:
    """One platoon per file, its vehicles in the order of the logs. Args: threshold of exposure to small TTC [s]."""
    files: dict[str, list[VehicleLog]] = {}
    for log in found:
        files.setdefault(log.source, []).append(log)
    return [_platoon(members, study, threshold, seed) for members in files.values()]


def _platoon(members: list[VehicleLog], study: PlatoonStudy, threshold: float, seed: int) -> Platoon:
    first = members[0]
    team = first.team if first.team != first.vehicle else ""
    name = " ".join(dict.fromkeys(part for part in (team, first.run or Path(first.source).stem) if part))
    if len(members) < 2:
        raise LogError(f"{members[0].source}: a platoon has two vehicles or more, this file one: {members[0].vehicle}")
    time, position, located, speed, valid = _common(members, study.period)
    dt = float(study.period)
    gap = np.full(speed.shape, np.inf)
    gap[1:] = np.maximum(np.hypot(*np.moveaxis(position[1:] - position[:-1], -1, 0)) - study.length, 0.0)
    gap[1:][~(located[1:] & located[:-1])] = np.inf
    moving = _longest(np.all((speed > study.moving) | ~valid, axis=0) & np.any(valid, axis=0))
    key = jax.random.key(seed)
    ahead = np.concatenate([speed[:1], speed[:-1]])
    space, own, front = (jnp.asarray(x, jnp.float32) for x in (gap, speed, ahead))
    # Standing, antennas may be closer than a length and speeds are noise: contact is measured while all drive.
    driving = (np.arange(len(time)) >= moving.start) & (np.arange(len(time)) < moving.stop)
    space = jnp.where(jnp.asarray(driving)[None], space, jnp.inf)
    ttc = time_to_collision(space, own, front_speed=front)
    counted = {"dt": jnp.asarray(dt, jnp.float32), "threshold": jnp.asarray(threshold, jnp.float32)}
    flow = _flows(time, position, located, gap, study)
    return Platoon(
        name=name,
        vehicles=[log.vehicle for log in members],
        time=time,
        speed=speed,
        gap=gap,
        valid=valid,
        spread=np.asarray(_gains(*_arrays(speed, valid)).spread),
        whole=_gain(time, speed, valid, slice(0, len(time)), study, key),
        moving=_gain(time, speed, valid, moving, study, key) if moving.stop - moving.start > 10 else None,
        spectra=jax.device_get(_transfer(*_arrays(speed, valid), rate=1 / dt, length=min(study.segment, len(time)))),
        headway=np.asarray(time_gap(space, own)),
        ttc=np.asarray(ttc),
        deceleration=np.asarray(required_deceleration(space, own, front_speed=front)),
        exposed=np.asarray(time_exposed(ttc, jnp.asarray(valid), **counted, relaxation=Relaxation())),
        integrated=np.asarray(time_integrated(ttc, jnp.asarray(valid), **counted)),
        flow=3600 * np.asarray(flow.flow)[np.asarray(flow.occupied)],
        density=1000 * np.asarray(flow.density)[np.asarray(flow.occupied)],
    )


def _arrays(speed: np.ndarray, valid: np.ndarray) -> tuple[jax.Array, jax.Array]:
    return jnp.asarray(np.where(valid, speed, 0), jnp.float32), jnp.asarray(valid)


def _common(members: list[VehicleLog], period: float) -> tuple[np.ndarray, ...]:
    """One clock [T] s, positions [V, T, 2] m, where they are known [V, T], speeds [V, T] m/s, where these are known.

    A position that is repeated while the vehicle moves is not known.
    """
    even = [by_time(log, period) for log in members]
    first, last = min(e.index.min() for e in even), max(e.index.max() for e in even)
    count = int(last - first) + 1
    position, speed = np.zeros((len(even), count, 2)), np.zeros((len(even), count))
    located, valid = np.zeros((2, len(even), count), bool)
    for v, (e, log) in enumerate(zip(even, members, strict=True)):
        at = e.index - first
        valid[v, at] = True
        there = by_time(log.take(~stuck(log)), period)
        position[v, there.index - first], located[v, there.index - first] = there.log.position, True
        moved = np.hypot(*np.gradient(e.log.position, period, axis=0).T) if e.log.n > 1 else np.zeros(e.log.n)
        stated = e.log.speed if e.log.speed is not None else moved
        speed[v, at] = np.where(np.isfinite(stated), stated, moved)
    return period * (first + np.arange(count)), position, located, speed, valid


def _longest(mask: np.ndarray) -> slice:
    """The longest run of samples that count."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    if not len(edges):
        return slice(0, 0)
    starts, ends = edges[::2], edges[1::2]
    k = int(np.argmax(ends - starts))
    return slice(int(starts[k]), int(ends[k]))


def _gain(
    time: np.ndarray, speed: np.ndarray, valid: np.ndarray, part: slice, study: PlatoonStudy, key: jax.Array
) -> Gain:
    arrays = _arrays(speed[:, part], valid[:, part])
    n = arrays[0].shape[1]
    block = min(max(round(float(study.block) / float(study.period)), 1), n)
    level = as_arrays(study.resampling.level)
    _, chain = _intervals(key, arrays[0], mask=arrays[1], block=block, draws=study.resampling.draws, level=level)
    found = _gains(*arrays)
    start, end = float(time[part.start]), float(time[part.stop - 1])
    return Gain(start, end, float(found.chain_l2), float(chain[0]), float(chain[1]), float(found.chain_linf))


def _flows(
    time: np.ndarray, position: np.ndarray, valid: np.ndarray, gap: np.ndarray, study: PlatoonStudy
) -> edie.Flow:
    """Edie's measures in cells of time and way. Ways are each vehicle's own, begun as far behind as it first was."""
    step = np.hypot(*np.moveaxis(np.diff(position, axis=1), -1, 0)) * (valid[:, 1:] & valid[:, :-1])
    way = np.concatenate([np.zeros((len(step), 1)), np.cumsum(step, axis=1)], axis=1)
    begun = [0.0]
    for v in range(1, len(way)):
        both = np.flatnonzero(valid[v] & valid[v - 1])
        lag = gap[v, both[0]] + study.length + way[v, both[0]] - way[v - 1, both[0]] if len(both) else 0.0
        begun.append(begun[-1] - float(lag))
    way = way + np.array(begun)[:, None]
    seconds, metres = (float(c) for c in study.cell)
    times = np.arange(time[0], time[-1] + 1e-6, seconds) - time[0]
    stations = np.arange(way[valid].min(), way[valid].max(), metres)
    if len(times) < 2 or len(stations) < 2:
        times, stations = np.array([0.0, time[-1] - time[0]]), np.array([way[valid].min(), way[valid].max()])
    way, time, times, stations = (jnp.asarray(x, jnp.float32) for x in (way, time - time[0], times, stations))
    return _diagram(way, time, mask=jnp.asarray(valid), times=times, stations=stations)
