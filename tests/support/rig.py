"""One link whose levers and torques anybody can check by hand.

Its pin is the origin. The cylinder stands 4 m below the pin and holds the link 3 m out, so that with the link level it
is 5 m long (3, 4, 5) and has the lever 3 * 4 / 5 = 2.4 m."""

from math import radians
from types import SimpleNamespace

import numpy as np

from cylforce.mechanics.linkages import Triangle
from cylforce.mechanics.machine import Cylinder, Link, Machine
from cylforce.mechanics.motion import motion
from cylforce.service.plausibility.pressure_groups import GroupConstants
from cylforce.signals.kinds import Kind, Signal

BAR = 1e5  # Pa
HEAD, ROD = 0.010, 0.006  # m^2
LEVER = 2.4  # m, of the level link
LINK = Link("arm", 3.0, 500.0, 2.0, 0.0, 0.0, radians(-40), radians(60), 0.0, 0.0, 0.0)
SIGNALS = ("head", "rod", "angle", "pitch", "slew")


def rig(foot=-4j, eye=3.0 + 0j):
    """The rig; with the foot above the pin (+4j) the lever is -2.4 m."""
    cylinder = Cylinder("lift", Triangle((0, foot), (1, eye)), HEAD, ROD, 3.0, 7.0)
    kinds = (Kind.HEAD_PRESSURE, Kind.ROD_PRESSURE, Kind.JOINT_ANGLE, Kind.PITCH, Kind.SLEW_RATE)
    signals = tuple(Signal(n, kind, 0, -1e9, 1e9, 0.01, 0.0) for n, kind in zip(SIGNALS, kinds, strict=True))
    return Machine("rig", (LINK,), (cylinder,), signals, 3.0 + 0j, 1000.0, 1.0, 0.0)


def turning(machine, rates):
    """Its motion with the link level, turning at rates (T,) [rad/s]."""
    rates = np.asarray(rates, dtype=np.float64)[:, None]
    return motion(machine, 0.0 * rates, rates, 0.0 * rates)


def readings(count, **given):
    """Signals (T, S), zero where not given."""
    return np.stack([np.broadcast_to(given.get(name, 0.0), count) for name in SIGNALS], axis=1).astype(np.float64)


def reading(values, name):
    """One signal (T,)."""
    return values[:, SIGNALS.index(name)]


def monitored(machine, rate_hz=100.0, rated_force=300e3):
    """What a detector needs of a machine alone, without a model of its columns."""
    spans = list(machine.spans)
    acting = [tuple(c for c, span in enumerate(spans) if joint in span) for joint in machine.rows]
    model = SimpleNamespace(machine=machine, filters=SimpleNamespace(rate_hz=rate_hz), acting=acting)
    return SimpleNamespace(
        model=model,
        rated_force=rated_force,
        groups=GroupConstants(machine),
        constants=lambda kind: kind(monitored(machine, rate_hz, rated_force)),
    )


def stepped(detector, groups, values, speed):
    """A detector of pressures after one more step."""
    groups.update(values, speed)
    detector.on_step(SimpleNamespace(groups=groups))
