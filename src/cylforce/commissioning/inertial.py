"""Does the base's inertial sensor lie as the machine file says? Compared with the tilt, on raw samples."""

import numpy as np

from cylforce.estimation.model import Model
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import INERTIAL, Kind
from cylforce.signals.units import DEGREE

# Mounted by hand a sensor is within 2 to 3 degrees, and accelerometers are within 2 to 3 % of gravity; the base's own
# acceleration averages out over the samples.
ALIGNED, EXACT = 6.0 * DEGREE, 0.06
ROCKS = 0.01  # rad/s rms of the pitch, from which on the sign of its rate is seen: twenty times the sensors' noise


def misplaced(model: Model, kept: Array) -> str | None:
    """One sentence when the inertial sensor cannot lie as the file says, by the samples `kept` (K, S); else None."""
    if not model.channels.inertial or len(kept) <= model.settle_steps:
        return None
    return _off_axis(model, kept) or _backwards(model, kept)


def _names(model: Model) -> list[str]:
    """Of rate, forward and upward acceleration."""
    return [next(s.name for s in model.machine.signals if s.kind is kind) for kind in INERTIAL]


def _off_axis(model: Model, kept: Array) -> str | None:
    channels = model.channels.read(kept).mean(axis=0)
    forward, upward = channels[model.channels.forces.stop + 1 : model.channels.forces.stop + 3].tolist()
    pitch, roll = channels[-3], channels[-2]
    gravity = model.machine.gravity * np.cos(roll) * np.exp(1j * pitch)
    expected = complex(gravity.imag, gravity.real)
    ratio = complex(forward, upward) / expected
    if abs(abs(ratio) - 1.0) < EXACT and abs(np.angle(ratio)) < ALIGNED:
        return None
    _, x, z = _names(model)
    return (
        f"{x} and {z} are {forward:.2f} and {upward:.2f} m/s^2 on average, but at this tilt {expected.real:.2f} and "
        f"{expected.imag:.2f}: the inertial sensor lies on another axis; mount it with x forward and z up, or correct "
        "object and sign of both entries, then start again"
    )


def _backwards(model: Model, kept: Array) -> str | None:
    if not any(s.kind is Kind.PITCH for s in model.machine.signals):
        return None
    turning = model.channels.turning(kept)[model.settle_steps :]
    gyro = model.channels.read(kept)[1 + model.settle_steps :, model.channels.forces.stop]
    if np.sqrt(np.mean(turning**2)) < ROCKS or turning @ gyro >= 0.0:
        return None
    return f"{_names(model)[0]} counts against the pitch: correct the sign of its scale (nose up is positive)"
