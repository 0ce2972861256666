"""Motion and rocker of the 20 t excavator by hand, from the pins of the machine file."""

import numpy as np

from cylforce.mechanics.motion import Attitude
from statics import BODIES, FILE, place

MOMENT, ROCKER = 60.0, FILE["cylinders"][2]["linkage"]  # kg m
DT, RATE, PITCH, ROLL = 1e-4, 0.7, 0.08, 0.1  # s, rad/s of the house, rad
MIDDLE = np.radians([20.0, -90.0, -60.0])
NAMES = ("level", "slope", "slewing")
ATTITUDES = (Attitude(), Attitude(PITCH, ROLL), Attitude(0.0, 0.0, 0.0, RATE))


def ends(theta):
    """The rocker's end and pin (2, 2), seen from the boom pin: the end is where rocker and link meet."""
    at = [place(theta, BODIES[ROCKER[p]["body"]], ROCKER[p]["at_m"]) for p in ("rocker_pin", "link_pin")]
    apart, a, b = np.hypot(*(at[1] - at[0])), ROCKER["rocker_m"], ROCKER["link_m"]
    angle = np.arctan2(*(at[1] - at[0])[::-1]) + np.arccos((apart**2 + a**2 - b**2) / (2 * apart * a))
    return np.array([at[0] + a * np.array([np.cos(angle), np.sin(angle)]), at[0]])


def moved(t):
    """Joint angles at a time: all joints at once, the bucket fast."""
    return MIDDLE + np.array([0.2, 0.4, 0.8]) * np.sin(np.array([0.9, 1.3, 2.1]) * t + np.array([0.0, 1.0, 2.0]))
