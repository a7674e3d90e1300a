"""Logs of vehicles: read and checked, judged, brought into one frame and onto one clock or station grid."""

from urbanjax.io.logs.format import Columns, LogFormat, Units
from urbanjax.io.logs.reader import read
from urbanjax.io.logs.record import LogError, LogReport, VehicleLog, from_arrays

__all__ = [
    "Columns",
    "LogError",
    "LogFormat",
    "LogReport",
    "Units",
    "VehicleLog",
    "from_arrays",
    "read",
]
