"""Whoever drives: the stack, and the plain drivers that give every score its scale."""

from urbanjax.drivers.blind import Blind
from urbanjax.drivers.constant_velocity import ConstantVelocity
from urbanjax.drivers.idm import IdmDriver
from urbanjax.drivers.pdm import PdmDriver
from urbanjax.drivers.protocol import Driver
from urbanjax.drivers.standstill import Standstill
from urbanjax.stack import StackParams

DRIVERS = {
    "stack": StackParams,
    "standstill": Standstill,
    "constant_velocity": ConstantVelocity,
    "blind": Blind,
    "idm": IdmDriver,
    "pdm": PdmDriver,
}

__all__ = ["DRIVERS", "Blind", "ConstantVelocity", "Driver", "IdmDriver", "PdmDriver", "Standstill"]
