"""An arm held still whose pressures follow from hand statics (statics.py), sent as frames through the service."""

from math import radians

import numpy as np

from cylforce.estimation.model import Model, Tares
from cylforce.service.service import WeighingService
from cylforce.settings.machine_file import load
from cylforce.signals.codec import encode
from cylforce.signals.events import Frame, Tick
from scenarios import EXCAVATOR, fed
from statics import G, moments, pressures, torques

SERVICE = load(EXCAVATOR).service._replace(adapt=False)
THETA = np.radians([20.0, -95.0, -30.0])
PITCH = radians(5.0)
PERIOD_US = 10_000
ROW_ERROR = 20.0  # N m


def tares(covariance=None, scale_error=0.0):
    """The data sheet's moments by hand, no friction, no slew."""
    model = Model(SERVICE.machine, SERVICE.filters, ("coulomb",))
    names = tuple(p.name for p in model.parameters)
    known = {f"{link}.{s}": v for link, each in moments().items() for s, v in zip("XZJ", each, strict=True)}
    spread = np.diag([(covariance or {}).get(name, 0.0) for name in names])
    values = np.array([known.get(name, 0.0) for name in names])
    return Tares(("coulomb",), names, values, spread, np.full(3, ROW_ERROR), True, 1.0, scale_error)


def readings(force=(0.0, 0.0), held=(0.0, 0.0, 0.0), theta=THETA, pitch=PITCH, g=G):
    """Readings of all sensors by name, SI; `g` is the gravity where the machine stands [m/s^2]."""
    angles = dict(zip(("boom_angle", "stick_angle", "bucket_angle"), theta, strict=True))
    found = pressures(theta, torques(theta, pitch, held, force, g))
    return found | angles | {"pitch": pitch, "roll": 0.0, "slew_rate": 0.0}


def served(core, course, seconds):
    """The service after these seconds and its estimates, every 10 ms; `course(t)` are the readings at time t [s]."""
    state, found = WeighingService.start(core), []
    for t_us in range(1_000_000, 1_000_000 + round(1e6 * seconds), PERIOD_US):
        said = course((t_us - 1_000_000) * 1e-6)
        for pdo in (pdo for node in SERVICE.nodes for pdo in node.pdos):
            fed(state, Frame(t_us, pdo.can_id, encode(pdo, said)))
        out = fed(state, Tick(t_us + 1000))
        found.append(out.estimate)
    return state, found


def estimates(core, course, seconds):
    """The estimates of `served`."""
    return served(core, course, seconds)[1]


# The readings of tilt and slew never change here: that is no fault.
PATIENT = SERVICE._replace(health=SERVICE.health._replace(frozen_samples=10**6))
