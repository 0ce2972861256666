"""The oil's temperature and what it does to friction."""

from math import exp, log10

WARM = 40.0 + 273.15  # K at which friction figures hold
# Walther's law through the grade ISO VG 46: 46 mm^2/s at 40 degC, 6.8 at 100 degC
SLOPE = (log10(log10(46.7)) - log10(log10(7.5))) / (log10(373.15) - log10(313.15))
LEVEL = log10(log10(46.7)) + SLOPE * log10(313.15)


def viscosity(kelvin: float) -> float:
    """Kinematic viscosity [mm^2/s]: log10 log10 (nu + 0.7) = A - B log10 T."""
    return float(10.0 ** (10.0 ** (LEVEL - SLOPE * log10(kelvin))) - 0.7)


def thinning(kelvin: float) -> float:
    """Viscosity relative to that at 40 degC."""
    return viscosity(kelvin) / 46.0


def warming(start: float, end: float, after_s: float, t_s: float) -> float:
    """Temperature of a tank that comes from `start` to `end` in `after_s` on its way to where losses balance, with a
    time constant of 40 minutes; same unit as given."""
    constant = 2400.0
    rest = start + (end - start) / (1.0 - exp(-after_s / constant))
    return rest + (start - rest) * exp(-t_s / constant)
