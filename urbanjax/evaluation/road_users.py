"""Everybody on the road during one drive, as columns: what a table of its log holds (host side)."""

from typing import Any

import jax
import numpy as np

from urbanjax.evaluation.batch import Outcome
from urbanjax.evaluation.facts import ROUNDING
from urbanjax.sim.log import Log
from urbanjax.types import ConfigError, Objects, RoadUser, host_record
from urbanjax.vehicle.params import VehicleParams

SHAPES = ("x", "y", "heading", "speed", "length", "width")  # of a box: m, rad, m/s
EGO = 0  # its number among the objects of a drive


@host_record
class Driven:
    """The road users of one drive until its end, the ego first."""

    time: np.ndarray  # [T] s
    number: np.ndarray  # [N] int32, of each object in the simulator, 0: the ego
    objects: Objects  # [T, N], centres of boxes; those who were never there are left out


def until_end(outcome: Outcome) -> Log:
    """The log [T] until the drive ends. Args: outcome, with its log. Raises ConfigError where it was not kept."""
    if outcome.log is None:
        raise ConfigError("this drive has no log: ask for it with outcomes(..., logs=True)")
    time = outcome.log.time - outcome.log.time[0]
    last = int(np.searchsorted(time, float(outcome.row["duration_s"]) + ROUNDING))
    return jax.tree.map(lambda x: x[: max(last, 2)], outcome.log)


def driven(outcome: Outcome, vehicle: VehicleParams) -> Driven:
    """Who was where in a drive, as it is in the log to the bit.

    Args: outcome, with its log; vehicle, the ego's dimensions [m], where the drive has none of its own. Raises
    ConfigError where no log was kept.
    """
    log, vehicle = until_end(outcome), outcome.vehicle or vehicle
    others, own = jax.tree.map(np.asarray, log.traffic), log.ego
    there = np.flatnonzero(others.valid.any(axis=0))
    one = np.asarray(own.speed)
    record: Any = Objects  # of NumPy arrays here
    ego = record(
        position=np.asarray(log.centre),
        heading=np.asarray(own.heading),
        speed=one,
        length=np.full_like(one, vehicle.length),
        width=np.full_like(one, vehicle.width),
        valid=np.ones(one.shape, bool),
        kind=np.full(one.shape, RoadUser.VEHICLE, np.int32),
    )
    kinds = others.kind if others.kind is not None else np.full(others.valid.shape, RoadUser.VEHICLE, np.int32)
    joined = jax.tree.map(
        lambda a, b: np.concatenate([a[:, None], b[:, there].astype(a.dtype)], axis=1), ego, others.replace(kind=kinds)
    )
    return Driven(np.asarray(log.time), np.concatenate([[EGO], there + 1]).astype(np.int32), joined)


def as_columns(drive: Driven) -> dict[str, np.ndarray]:
    """Columns [N T] by name, one object after the other.

    step, object (its number), time [s], x and y [m], heading [rad], speed [m/s], length and width [m], kind (RoadUser)
    and valid. Args: drive, of T steps and N objects.
    """
    steps, count = drive.objects.valid.shape
    boxes = {"x": drive.objects.position[..., 0], "y": drive.objects.position[..., 1]}
    boxes |= {name: getattr(drive.objects, name) for name in (*SHAPES[2:], "kind", "valid")}
    return {
        "step": np.tile(np.arange(steps, dtype=np.int32), count),
        "object": np.repeat(drive.number, steps),
        "time": np.tile(drive.time, count),
        **{name: np.ascontiguousarray(values.T).reshape(-1) for name, values in boxes.items()},
    }


def from_columns(columns: dict[str, Any]) -> Driven:
    """The drive of which these are the columns, in any order. Args: columns [N T], see `as_columns`."""
    step, number = np.asarray(columns["step"]), np.asarray(columns["object"])
    order = np.lexsort((number, step))
    numbers = np.unique(number).astype(np.int32)
    rows = {name: np.asarray(values)[order].reshape(-1, len(numbers)) for name, values in columns.items()}
    rest = {name: rows[name] for name in (*SHAPES[2:], "kind", "valid")}
    record: Any = Objects  # of NumPy arrays here
    return Driven(
        rows["time"][:, 0],
        numbers,
        record(position=np.stack([rows["x"], rows["y"]], axis=-1), **rest),
    )
