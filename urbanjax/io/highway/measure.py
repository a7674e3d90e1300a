"""What is measured of a drive in highway-env."""

from typing import Any

import numpy as np


def time_to_collision(ego: Any, others: list[Any], horizon: float = 20.0) -> float:
    """Time in s until the ego's box first touches another's when all keep their velocity; inf beyond `horizon`.

    Exact for boxes that translate: on each axis of the two boxes the times of overlap form an interval, and they
    touch while all four intervals hold.
    """
    near = [other for other in others if other is not ego and not other.crashed]
    if not near:
        return np.inf
    position = np.array([other.position for other in near]) - ego.position
    velocity = np.array([other.velocity for other in near]) - ego.velocity
    half = np.array([[other.LENGTH, other.WIDTH] for other in near]) / 2
    along = np.array([other.direction for other in near])
    own = np.broadcast_to(ego.direction, along.shape)
    own_half = np.broadcast_to(np.array([ego.LENGTH, ego.WIDTH]) / 2, half.shape)
    first, last = np.zeros(len(near)), np.full(len(near), horizon)
    for axis in (own, _left(own), along, _left(along)):
        reach = _extent(own, own_half, axis) + _extent(along, half, axis)
        begin, end = _overlap(np.sum(position * axis, -1), np.sum(velocity * axis, -1), reach)
        first, last = np.maximum(first, begin), np.minimum(last, end)
    hit = first < last
    return float(first[hit].min()) if hit.any() else np.inf


def _left(direction: np.ndarray) -> np.ndarray:
    return np.stack([-direction[:, 1], direction[:, 0]], -1)


def _extent(direction: np.ndarray, half: np.ndarray, axis: np.ndarray) -> np.ndarray:
    along, across = np.sum(direction * axis, -1), np.sum(_left(direction) * axis, -1)
    return half[:, 0] * np.abs(along) + half[:, 1] * np.abs(across)


def _overlap(distance: np.ndarray, speed: np.ndarray, reach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times between which |distance + speed t| <= reach."""
    still = np.abs(speed) < 1e-9
    speed = np.where(still, 1.0, speed)
    times = np.sort(np.stack([(-reach - distance) / speed, (reach - distance) / speed]), axis=0)
    inside = np.abs(distance) <= reach
    begin = np.where(still, np.where(inside, -np.inf, np.inf), times[0])
    end = np.where(still, np.where(inside, np.inf, -np.inf), times[1])
    return begin, end
