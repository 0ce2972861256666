"""SI units and those of the reader at the machine: the one place where a report converts."""

import numpy as np

NO_BREAK = "\u00a0"

# SI unit: (unit shown, how many of it make one SI unit)
SHOWN: dict[str, tuple[str, float]] = {
    "Pa": ("bar", 1e-5),
    "Pa/h": ("bar/h", 1e-5),
    "rad": ("°", float(np.degrees(1.0))),
    "rad (m)": ("°", float(np.degrees(1.0))),
    "rad/(N m)": ("°/MN m", 1e6 * float(np.degrees(1.0))),
    "rad^2/s^2": ("(°/s)²", float(np.degrees(1.0)) ** 2),
    "m": ("mm", 1e3),
    "s": ("ms", 1e3),
    "N": ("kN", 1e-3),
    "N s/m": ("kN s/m", 1e-3),
    "N m/rad": ("N m/°", float(np.radians(1.0))),
    "1": ("%", 1e2),
}


def shown(value: float, unit: str) -> str:
    """A value in SI `unit` as the reader knows it, number and unit on one line."""
    name, factor = SHOWN.get(unit, (unit, 1.0))
    return f"{_plain(value * factor)} {name}".replace(" ", NO_BREAK)


def interval(low: float, high: float, unit: str) -> str:
    """From `low` to `high` [SI] likewise."""
    factor = SHOWN.get(unit, (unit, 1.0))[1]
    return f"{_plain(low * factor)} to {shown(high, unit)}"


def _plain(value: float) -> str:
    """Three digits, no power of ten."""
    return f"{value:.0f}" if abs(value) >= 1000.0 else f"{value:.3g}"
