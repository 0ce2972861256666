"""Units at the edges: everything inside is SI; these factors turn other units into SI."""

from math import pi

BAR = 1e5  # Pa
DEGREE = pi / 180.0  # rad
MILLIMETRE = 1e-3  # m
MICROSECOND = 1e-6  # s
ZERO_CELSIUS = 273.15  # K, the offset between degrees Celsius and kelvin
STANDARD_GRAVITY = 9.80665  # m/s^2
