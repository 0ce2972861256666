"""Signals: measured quantities, their places on the machine, and the limits within which a value is accepted."""

from dataclasses import dataclass
from enum import StrEnum


class Kind(StrEnum):
    """Measured quantity of a sensor; the SI unit of each is in `UNIT`.

    FORCE_PIN:        force of a cylinder, positive: it pushes
    JOINT_ANGLE:      angle of a link from the link before it, of the first link from the house
    LINK_INCLINATION: angle of a link from the true horizontal
    CYLINDER_LENGTH:  length of a cylinder from pin to pin
    PITCH:            pitch of the house from the true horizontal, positive: nose up
    """

    HEAD_PRESSURE = "head_pressure"
    ROD_PRESSURE = "rod_pressure"
    FORCE_PIN = "force_pin"
    JOINT_ANGLE = "joint_angle"
    LINK_INCLINATION = "link_inclination"
    CYLINDER_LENGTH = "cylinder_length"
    PITCH = "pitch"
    ROLL = "roll"
    PITCH_RATE = "pitch_rate"
    FORWARD_ACCELERATION = "forward_acceleration"
    UPWARD_ACCELERATION = "upward_acceleration"
    SLEW_RATE = "slew_rate"
    SLEW_ANGLE = "slew_angle"
    OIL_TEMPERATURE = "oil_temperature"


UNIT: dict[Kind, str] = {
    Kind.HEAD_PRESSURE: "Pa",
    Kind.ROD_PRESSURE: "Pa",
    Kind.FORCE_PIN: "N",
    Kind.JOINT_ANGLE: "rad",
    Kind.LINK_INCLINATION: "rad",
    Kind.CYLINDER_LENGTH: "m",
    Kind.PITCH: "rad",
    Kind.ROLL: "rad",
    Kind.PITCH_RATE: "rad/s",
    Kind.FORWARD_ACCELERATION: "m/s^2",
    Kind.UPWARD_ACCELERATION: "m/s^2",
    Kind.SLEW_RATE: "rad/s",
    Kind.SLEW_ANGLE: "rad",
    Kind.OIL_TEMPERATURE: "K",
}


# Angles: readings of these sensors repeat after a whole turn.
ANGLE_UNIT = "rad"
ANGLES = tuple(kind for kind, unit in UNIT.items() if unit == ANGLE_UNIT)
# The chambers of a cylinder.
SIDES = (Kind.HEAD_PRESSURE, Kind.ROD_PRESSURE)
# An inertial sensor on the base measures its rate in the arm's plane (positive: nose up) and its specific force, which
# is gravity's counterforce while it does not move: 9.8 m/s^2 upwards.
INERTIAL = (Kind.PITCH_RATE, Kind.FORWARD_ACCELERATION, Kind.UPWARD_ACCELERATION)


@dataclass(frozen=True, slots=True)
class Signal:
    """One measured quantity.

    name:           name in the machine file
    kind:           measured quantity
    index:          number of the cylinder (pressures, force pin, cylinder length) or of the link (joint angle,
                    inclination), from 0 at the house outwards; 0 for a signal of the chassis
    low, high:      range in which a value is accepted [SI]
    period_s:       time between two values [s]
    standard_error: of the sensor [SI]
    """

    name: str
    kind: Kind
    index: int
    low: float
    high: float
    period_s: float
    standard_error: float

    @property
    def unit(self) -> str:
        """SI unit of the values."""
        return UNIT[self.kind]
