"""Recorded traffic (host side, float64, relative to the graph's origin)."""

from collections.abc import Hashable, Sequence

import numpy as np

from urbanjax.types import ScenarioError, host_record


@host_record
class RecordedTrack:
    """One road user as a file states it, before all are brought onto one clock."""

    id: Hashable
    kind: str
    length: float  # m
    width: float  # m
    step: np.ndarray  # [n] int, rising
    position: np.ndarray  # [n, 2] m, box centre, map coordinates
    heading: np.ndarray  # [n] rad
    speed: np.ndarray  # [n] m/s
    standing: bool = False  # an obstacle that never moves: there at all times


@host_record
class Recording:
    """V road users at T times; entries are meaningful where `valid`, and hold the nearest valid state elsewhere."""

    dt: float  # s
    ids: tuple[Hashable, ...]  # [V]
    kind: tuple[str, ...]  # [V] as the file has it: "car", "truck", "bicycle", ...
    standing: np.ndarray  # [V] bool, obstacles that never move
    length: np.ndarray  # [V] m
    width: np.ndarray  # [V] m
    position: np.ndarray  # [T, V, 2] m, box centre, relative to the graph's origin
    heading: np.ndarray  # [T, V] rad, unwrapped
    speed: np.ndarray  # [T, V] m/s
    valid: np.ndarray  # [T, V] bool

    def __post_init__(self) -> None:
        """Raises ScenarioError for an array of another shape: times come first, as in every log of the house."""
        steps, count = self.valid.shape if np.ndim(self.valid) == 2 else (-1, -1)
        rows = {"position": (steps, count, 2), "heading": (steps, count), "speed": (steps, count)}
        for name, shape in {**rows, **dict.fromkeys(("standing", "length", "width"), (count,))}.items():
            if np.shape(getattr(self, name)) != shape:
                found = np.shape(getattr(self, name))
                raise ScenarioError(
                    f"Recording.{name} has the shape {found}, and valid {np.shape(self.valid)}: T times by V "
                    "road users are needed, valid [T, V], position [T, V, 2], length [V]"
                )
        if len(self.ids) != count or len(self.kind) != count:
            raise ScenarioError(f"Recording: {len(self.ids)} ids and {len(self.kind)} kinds for {count} road users")

    @property
    def n_times(self) -> int:
        """T."""
        return self.valid.shape[0]


def record(tracks: Sequence[RecordedTrack], dt: float, *, origin: tuple[float, float]) -> Recording:
    """All tracks on one clock of T steps from 0; what lies between two states of a track is valid and interpolated.

    Args: tracks, the road users; dt [s], one step of the clock; origin [m], of the graph, taken off positions.
    """
    steps = 1 + max((int(track.step[-1]) for track in tracks), default=0)
    count = len(tracks)
    position, heading, speed = np.zeros((steps, count, 2)), np.zeros((steps, count)), np.zeros((steps, count))
    valid = np.zeros((steps, count), bool)
    clock = np.arange(steps)
    for v, track in enumerate(tracks):
        for k in range(2):
            position[:, v, k] = np.interp(clock, track.step, track.position[:, k] - origin[k])
        heading[:, v] = np.interp(clock, track.step, np.unwrap(track.heading))
        speed[:, v] = np.interp(clock, track.step, track.speed)
        valid[:, v] = track.standing | ((clock >= track.step[0]) & (clock <= track.step[-1]))
    return Recording(
        dt=dt,
        ids=tuple(track.id for track in tracks),
        kind=tuple(track.kind for track in tracks),
        standing=np.array([track.standing for track in tracks], bool),
        length=np.array([track.length for track in tracks], float),
        width=np.array([track.width for track in tracks], float),
        position=position,
        heading=heading,
        speed=speed,
        valid=valid,
    )
