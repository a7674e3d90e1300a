"""Which reader a map's file is for."""

import warnings
from pathlib import Path

from urbanjax.io.files import file_of
from urbanjax.io.maps import commonroad, lanelet2, racetrack, sumo
from urbanjax.io.maps.road import RoadMap
from urbanjax.io.maps.xml import parse

READERS = {"commonRoad": commonroad.read, "osm": lanelet2.read, "net": sumo.read}  # by the root element

SHOWN = 3  # dangling references that the warning names


class DanglingWarning(UserWarning):
    """A map names what it does not hold."""


def read(path: str | Path) -> RoadMap:
    """The map of a CommonRoad (2018b, 2020a), Lanelet2 or SUMO file, told by its content, or of a racetrack's CSV.

    What it names but does not hold, as clipped maps do, is left out, with a DanglingWarning.
    Args: path of the file. Raises MapError, naming the file and the element, for what is no such map or a malformed
    one.
    """
    path = file_of(path)
    if path.suffix.lower() == ".csv":
        return racetrack.read(path)
    xml = parse(path)
    if xml.root.tag == "OpenDRIVE":
        raise xml.fail(xml.root, "OpenDRIVE is not read: convert it, say to SUMO's .net.xml (netconvert --opendrive)")
    if xml.root.tag not in READERS:
        raise xml.fail(xml.root, "no map: one begins with <commonRoad>, <osm> or <net>")
    found = READERS[xml.root.tag](xml)
    dangling = [f"lane {fault.lane}: {fault.detail}" for fault in found.faults if fault.kind == "dangling link"]
    if dangling:
        more = f" and {len(dangling) - SHOWN} more (see faults of the map)" if len(dangling) > SHOWN else ""
        message = f"{path}: left out what the file names but does not hold: {'; '.join(dangling[:SHOWN])}{more}"
        warnings.warn(message, DanglingWarning, stacklevel=2)
    return found
