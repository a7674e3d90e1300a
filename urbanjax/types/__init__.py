"""The nouns that every room speaks. SI units; x forward, y left, heading counter-clockwise."""

from urbanjax.types.errors import (
    CloudError,
    ConfigError,
    FileError,
    ProcessError,
    RoadError,
    RouteError,
    ScenarioError,
    UrbanJaxError,
)
from urbanjax.types.limits import INSIDE, POSITIVE, SEED, SHARE
from urbanjax.types.objects import Objects, Prediction, RoadUser
from urbanjax.types.observation import LaneOffset, Observation
from urbanjax.types.path import Path
from urbanjax.types.pinned import SOFT
from urbanjax.types.scan import Mount, Scan
from urbanjax.types.signals import Signals, SignalState
from urbanjax.types.state import Command, Odometry, VehicleState
from urbanjax.types.status import Decision, Status
from urbanjax.types.struct import HANDED_DOWN, as_arrays, field, host_record, pytree, static
from urbanjax.types.unread import Unread
from urbanjax.types.values import batched_values, with_values

__all__ = [
    "HANDED_DOWN",
    "INSIDE",
    "POSITIVE",
    "SEED",
    "SHARE",
    "SOFT",
    "CloudError",
    "Command",
    "ConfigError",
    "Decision",
    "FileError",
    "LaneOffset",
    "Mount",
    "Objects",
    "Observation",
    "Odometry",
    "Path",
    "Prediction",
    "ProcessError",
    "RoadError",
    "RoadUser",
    "RouteError",
    "Scan",
    "ScenarioError",
    "SignalState",
    "Signals",
    "Status",
    "Unread",
    "UrbanJaxError",
    "VehicleState",
    "as_arrays",
    "batched_values",
    "field",
    "host_record",
    "pytree",
    "static",
    "with_values",
]
