"""Surrogate safety measures of plain arrays."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from urbanjax.traffic.safety.measure import Safety, SafetyParams, measure
from urbanjax.traffic.safety.plausible import check_units
from urbanjax.types import Objects, as_arrays
from urbanjax.types.arguments import array, kind, number, short
from urbanjax.types.errors import TrafficError

DTS = (1e-4, 60.0)  # s, between two samples
WIDEST = 1.0  # m: people may be wider than long, vehicles are not
_measure = jax.jit(measure)


def surrogate_safety(
    position: Any,
    heading: Any,
    *,
    speed: Any,
    dt: float,
    size: tuple[Any, Any] = (4.5, 1.8),
    valid: Any = None,
    params: SafetyParams | None = None,
) -> Safety:
    """Times to collision, headways, required decelerations, post-encroachment times and RSS of V vehicles at T times.

    `summary` has one number per vehicle, `pairs` one per ordered pair, `series` one per vehicle and time;
    docs/safety.md defines them. For many scenarios compile and vmap `traffic.safety.measure.measure`.
    Args: position [T, V, 2] m, of box centres; heading [T, V] rad, counter-clockwise from x; speed [T, V] m/s, along
    the heading; dt [s] between two times; size, length and width in m, each a number, [V] or
    [T, V]; valid [T, V], which vehicles are
    there (default: those that are finite); params, thresholds. Raises TrafficError for arrays of another shape, for
    what is there and not finite, for a dt or a size that cannot be, and where speed or heading contradict
    the positions.
    """
    rows = {"position": position, "heading": heading, "speed": speed}
    given = {name: array(values, name, error=TrafficError) for name, values in rows.items()}
    shape = given["position"].shape[:2]
    if given["position"].ndim != 3 or given["position"].shape[2] != 2 or 0 in shape:
        raise TrafficError(f"position has the shape {given['position'].shape}: give [T, V, 2], at least one of each")
    for name in ("heading", "speed"):
        if given[name].shape != shape:
            raise TrafficError(
                f"{name} has the shape {given[name].shape}, and position {given['position'].shape}: give [T, V] and "
                "[T, V, 2]"
            )
    dt = number(dt, "dt", error=TrafficError)
    if params is not None:
        kind(params, "params", wanted=SafetyParams, error=TrafficError)
    finite = np.isfinite(given["heading"]) & np.isfinite(given["speed"]) & np.isfinite(given["position"]).all(-1)
    there = finite if valid is None else np.asarray(valid)
    if there.shape != shape or there.dtype != bool:
        raise TrafficError(f"valid has the shape {there.shape} of {there.dtype}: truth values {shape} are needed")
    if (there & ~finite).any():
        t, v = np.argwhere(there & ~finite)[0]
        raise TrafficError(f"vehicle {v} at time {t} is valid and not finite: correct it, or say valid=False")
    if not there.any():
        raise TrafficError("no vehicle is there at any time: nothing is valid, or nothing is finite")
    if not isinstance(size, tuple | list) or len(size) != 2:
        raise TrafficError(f"size is {short(size)}: give two, the length and the width")
    if not DTS[0] <= dt <= DTS[1]:
        raise TrafficError(f"dt is {dt:g} s: samples of one scene are between {DTS[0]:g} and {DTS[1]:g} s apart")
    sizes = {name: _size(name, values, shape) for name, values in zip(("length", "width"), size, strict=True)}
    if (sizes["width"] > sizes["length"]).all() and sizes["width"].max() > WIDEST:
        raise TrafficError("size: each width is greater than the length; give the length first")
    check_units(given["position"], given["heading"], speed=given["speed"], valid=there, dt=dt)
    # Float32 near the middle of all: map coordinates of many kilometres have no millimetres.
    middle = given["position"][there].mean(0)
    given["position"] = np.where(there[..., None], given["position"] - middle, 0)
    arrays: dict[str, Any] = as_arrays({**given, **sizes})
    tracks = Objects(**arrays, valid=jnp.asarray(there))
    return _measure(tracks, jnp.asarray(dt, float), params=as_arrays(params or SafetyParams()))


def _size(name: str, values: Any, shape: tuple[int, int]) -> np.ndarray:
    size = array(values, name, error=TrafficError)
    if size.shape not in ((), (shape[1],), shape):
        raise TrafficError(f"{name} has the shape {size.shape}: give a number, [V] or [T, V], here {shape}")
    if not np.isfinite(size).all() or size.min() <= 0:
        raise TrafficError(f"{name} must be positive and finite, in metres")
    return np.broadcast_to(size, shape)
