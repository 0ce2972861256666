"""Factors from other units to SI. All values inside the program are SI; other units appear only in files and on the
bus."""

from math import pi

BAR = 1e5  # Pa
DEGREE = pi / 180.0  # rad
MILLIMETRE = 1e-3  # m
MILLISECOND = 1e-3  # s
MICROSECOND = 1e-6  # s
ZERO_CELSIUS = 273.15  # K, the offset between degrees Celsius and kelvin
STANDARD_GRAVITY = 9.80665  # m/s^2, by definition (CGPM 1901)
