"""Factors from other units to SI. All values inside the program are SI; other units appear only in files and on the
bus."""

from math import pi
from typing import NamedTuple

BAR = 1e5  # Pa
DEGREE = pi / 180.0  # rad
MILLIMETRE = 1e-3  # m
MILLISECOND = 1e-3  # s
MICROSECOND = 1e-6  # s
ZERO_CELSIUS = 273.15  # K, the offset between degrees Celsius and kelvin
STANDARD_GRAVITY = 9.80665  # m/s^2, by definition (CGPM 1901)

POUND = 0.45359237  # kg, by definition (international yard and pound agreement, 1959)


class MassUnit(NamedTuple):
    """A unit in which masses are displayed.

    symbol: of the unit
    kg:     size of the unit [kg]
    digits: number of decimals on a display
    fine:   number of decimals of single buckets on lists and tickets
    """

    symbol: str
    kg: float
    digits: int
    fine: int

    def text(self, mass: float) -> str:
        """Return a mass [kg] as a list or a ticket shows it, without the symbol."""
        return f"{mass / self.kg:.{self.fine}f}"

    def coarse(self, mass: float) -> str:
        """Return a mass [kg] as a display shows it, without the symbol."""
        return f"{mass / self.kg:.{self.digits}f}"


KILOGRAM = MassUnit("kg", 1.0, 0, 1)
MASS_UNITS = {
    "kg": KILOGRAM,
    "t": MassUnit("t", 1000.0, 2, 3),
    "lb": MassUnit("lb", POUND, 0, 0),
    "short-ton": MassUnit("sh tn", 2000.0 * POUND, 2, 3),
}


def mass_unit(name: str) -> MassUnit:
    """Return the unit of mass with a name, such as "t". Raises ValueError with a sentence that lists all names."""
    if name not in MASS_UNITS:
        raise ValueError(f"--unit {name}: is no unit of mass: use {', '.join(MASS_UNITS)}")
    return MASS_UNITS[name]
