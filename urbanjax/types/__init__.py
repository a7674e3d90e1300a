"""The nouns that every room speaks. SI units; x forward, y left, heading counter-clockwise."""

from urbanjax.types.errors import (
    CloudError,
    ConfigError,
    FileError,
    RoadError,
    RouteError,
    ScenarioError,
    UrbanJaxError,
)
from urbanjax.types.objects import Objects, Prediction
from urbanjax.types.observation import Observation
from urbanjax.types.path import Path
from urbanjax.types.scan import Scan
from urbanjax.types.signals import Signals, SignalState
from urbanjax.types.state import Command, Odometry, VehicleState
from urbanjax.types.status import Decision, RouteStatus
from urbanjax.types.struct import as_arrays, field, pytree, static

__all__ = [
    "CloudError",
    "Command",
    "ConfigError",
    "Decision",
    "FileError",
    "Objects",
    "Observation",
    "Odometry",
    "Path",
    "Prediction",
    "RoadError",
    "RouteError",
    "RouteStatus",
    "Scan",
    "ScenarioError",
    "SignalState",
    "Signals",
    "UrbanJaxError",
    "VehicleState",
    "as_arrays",
    "field",
    "pytree",
    "static",
]
