"""Which reader a map's file is for."""

from pathlib import Path

from urbanjax.io.files import path_of
from urbanjax.io.maps import commonroad, lanelet2, racetrack, sumo
from urbanjax.io.maps.road import RoadMap
from urbanjax.io.maps.xml import parse

READERS = {"commonRoad": commonroad.read, "osm": lanelet2.read, "net": sumo.read}  # by the root element


def read(path: str | Path) -> RoadMap:
    """The map of a CommonRoad (2018b, 2020a), Lanelet2 or SUMO file, told by its content, or of a racetrack's CSV.

    Args: path of the file. Raises MapError, naming the file and the element, for what is no such map or a malformed
    one.
    """
    path = path_of(path)
    if path.suffix.lower() == ".csv":
        return racetrack.read(path)
    xml = parse(path)
    if xml.root.tag not in READERS:
        raise xml.fail(xml.root, "no map: one begins with <commonRoad>, <osm> or <net>")
    return READERS[xml.root.tag](xml)
