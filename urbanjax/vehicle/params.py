"""The vehicle's dimensions and limits."""

from typing import ClassVar

from jax import Array

from urbanjax.types import POSITIVE, field, pytree


@pytree
class VehicleParams:
    """A mid-size car; the reference point is the centre of the rear axle."""

    PINNED: ClassVar[dict[str, str]] = {"*": "fact: of the vehicle"}

    wheelbase: float = field(default=2.8, metadata=POSITIVE)  # m
    length: float = field(default=4.7, metadata=POSITIVE)  # m
    width: float = field(default=1.9, metadata=POSITIVE)  # m
    rear_overhang: float = 0.95  # m, from the rear axle to the rear bumper
    max_acceleration: float = 2.5  # m/s^2
    max_deceleration: float = 6.0  # m/s^2, positive
    max_steering: float = 0.6  # rad, at the road wheels
    max_steering_rate: float = 0.8  # rad/s
    max_speed: float = 40.0  # m/s

    @property
    def centre_offset(self) -> float | Array:
        """Distance from the rear axle forward to the centre of the box, in metres."""
        return self.length / 2 - self.rear_overhang
