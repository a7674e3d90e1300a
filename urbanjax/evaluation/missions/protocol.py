"""What an evaluation asks of a kind of drives."""

import abc
from collections.abc import Hashable
from typing import Protocol, runtime_checkable

from urbanjax.evaluation.case import Case
from urbanjax.sim.agents import TrafficParams
from urbanjax.vehicle.params import VehicleParams


@runtime_checkable
class Drives(Protocol):
    """Drives that are told apart by a seed, or a number (host side)."""

    @property
    @abc.abstractmethod
    def name(self) -> str:
        """Of the mission, in rows."""

    @property
    @abc.abstractmethod
    def size(self) -> Hashable:
        """What the shapes of its cases depend on: missions of one size share a program."""

    @property
    @abc.abstractmethod
    def longest(self) -> float:
        """Duration [s] after which a drive ends, whatever has come of it; that of all logs."""

    @abc.abstractmethod
    def case(self, seed: int, *, others: TrafficParams, vehicle: VehicleParams) -> Case:
        """One drive. Args: seed; others, how traffic drives; vehicle, that of the closed loop."""
