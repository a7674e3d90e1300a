"""Recorded traffic from the data folder, or another, as scenes to be driven in."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from urbanjax.evaluation.recorded.scenes import RecordedScene, prepare, problems
from urbanjax.io import maps
from urbanjax.io.files import data_folder
from urbanjax.io.maps import RoadMap
from urbanjax.roadmap.corridor import CorridorParams
from urbanjax.types import ConfigError
from urbanjax.vehicle.params import VehicleParams

EGOS = ("vehicles", "problems")  # every recorded vehicle, or the planning problems of the files
SAME = 1e-6  # s, by which periods may differ


def paths(names: tuple[str, ...], folder: str, *, key: str) -> list[Path]:
    """Where recordings lie. Raises ConfigError, naming the first one that is missing.

    Args: names, with or without .xml; folder, by default that of the data beside; key, of the config, that named them.
    """
    where = Path(folder or data_folder() / "maps" / "commonroad_recorded")
    if folder and not where.is_dir():
        raise ConfigError(f"'folder' is {folder!r}, which is no folder: name the one that holds the {key!r}")
    found = [where / f"{name.removesuffix('.xml')}.xml" for name in names]
    for path in found:
        if not path.is_file():
            raise ConfigError(f"there is no {path.name} in {where}: set 'folder' or URBANJAX_DATA")
    return found


def read(path: Path, period: float, *, key: str) -> RoadMap:
    """A map with its recording. Args: period [s], of the closed loop; key, of the config, that named it.

    Raises ConfigError where nobody was recorded, or with another period.
    """
    road = maps.read(path)
    if road.recording is None:
        raise ConfigError(f"{path} holds no recorded traffic: choose other {key!r}")
    if abs(road.recording.dt - float(period)) > SAME:
        raise ConfigError(f"{path} was recorded every {road.recording.dt} s: set period={road.recording.dt}")
    return road


def scene_of(
    road: RoadMap, corridor: CorridorParams, *, egos: str, shortest: float, vehicle: VehicleParams
) -> RecordedScene:
    """The scene with a start in the place of every recorded driver, or one for every planning problem.

    Args: road, with its recording; corridor, along routes; egos, one of EGOS; shortest [s], that the record of a driver
    must last; vehicle, the ego's.
    """
    assert road.recording is not None
    how: dict[str, Any] = {"params": corridor, "vehicle": vehicle, "cycles": road.cycles}
    if egos == "problems":
        return problems(road.path.stem, road.graph, recording=road.recording, tasks=road.problems, **how)
    return prepare(road.path.stem, road.graph, recording=road.recording, shortest=float(shortest), **how)


def signals(scenes: Sequence[RecordedScene]) -> dict[str, list[Any]]:
    """How many signals of each scene show what the map's programs say, and how many are green for want of one."""
    return {
        "scene": [scene.name for scene in scenes],
        "signals by the map's program": [scene.with_program for scene in scenes],
        "signals shown green": [scene.graph.n_signals - scene.with_program for scene in scenes],
    }
