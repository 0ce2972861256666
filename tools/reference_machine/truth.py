"""What the machine really is, in the estimator's terms: base parameters of its links."""

from math import cos, sin

import numpy as np
from numpy.typing import NDArray

from .arm import GRAVITY, Arm
from .datasheet import JOINTS
from .specimen import SHARES, Body, Specimen

Array = NDArray[np.float64]
SYMBOLS = ("J", "X", "Z")


def base_columns(lengths: tuple[float, ...], angles: Array, rates: Array, turns: Array) -> Array:
    """Joint torques (N, 3 N) per (J, X, Z) of each link at one state: absolute angles, rates, their derivatives.

    From the energies: T = sum over bodies of (J w^2)/2 + v . (rotated first moment) w, v the inner pin's speed, with
    what hangs beyond a link in its J and X. Every link's pin is at p_j = sum l_i e_i; its equation of motion is
    Q_j = J q'' + (first moment, turned a quarter) . (pin acceleration + gravity), and the pins beyond carry the rest.
    """
    count = len(angles)
    w = np.zeros((count, 3 * count))
    e = [np.array([cos(q), sin(q)]) for q in angles]
    n = [np.array([-sin(q), cos(q)]) for q in angles]
    pin = np.array([0.0, GRAVITY])  # acceleration of link j's inner pin, gravity's included
    for j in range(count):
        w[j, 3 * j : 3 * j + 3] += (turns[j], n[j] @ pin, -(e[j] @ pin))
        # the link's first moment, accelerated, acts on the pins before it
        moment_x = n[j] * turns[j] - e[j] * rates[j] ** 2
        moment_z = -e[j] * turns[j] - n[j] * rates[j] ** 2
        for i in range(j):
            w[i, 3 * j + 1] += lengths[i] * (n[i] @ moment_x)
            w[i, 3 * j + 2] += lengths[i] * (n[i] @ moment_z)
        pin = pin + lengths[j] * moment_x
    return np.triu(np.ones((count, count))) @ w


def links_parameters(specimen: Specimen) -> dict[str, float]:
    """(J, X, Z) of the links alone: J about the pin and X, Z the first moments, with what hangs beyond in J and X."""
    found: dict[str, float] = {}
    beyond = 0.0
    for joint in reversed(JOINTS):
        body, length = specimen.bodies[joint], specimen.lengths[joint]
        x, z = body.centre
        turn = body.inertia + body.mass * (x * x + z * z) + beyond * length**2
        found |= {
            f"{joint}.J": turn,
            f"{joint}.X": body.mass * x + beyond * length,
            f"{joint}.Z": body.mass * z,
        }
        beyond += body.mass
    return found


def slew_parameters(specimen: Specimen, turn: dict[str, float]) -> dict[str, float]:
    """(D, E) of each link with its J in `turn`; the linkages' masses as the data sheet shares them out."""
    found: dict[str, float] = {}
    for joint in JOINTS:
        body = specimen.bodies[joint]
        zz = body.zz + body.mass * body.centre[1] ** 2
        xz = body.xz + body.mass * body.centre[0] * body.centre[1]
        for kg, (x, z) in SHARES[joint] if specimen.bars else ():
            zz, xz = zz + kg * z * z, xz + kg * x * z
        found |= {f"{joint}.D": turn[f"{joint}.J"] - 2.0 * zz, f"{joint}.E": xz}
    return found


def effective_parameters(
    specimen: Specimen, rng: np.random.Generator, states: int = 400
) -> tuple[dict[str, float], Array]:
    """(J, X, Z) that fit MuJoCo's own dynamics best over the working range, the linkages' masses included, and the rms
    torque (N,) [N m] that they leave: zero when the linkages are massless."""
    arm, lengths = Arm(specimen), tuple(specimen.lengths[j] for j in JOINTS)
    rows, torques = [], []
    for _ in range(states):
        angles, rates, torque = _state(specimen, rng)
        arm.place(0.0, angles)
        arm.drive(0.0, rates)
        arm.data.qfrc_applied[1:4] = torque
        arm.data.qfrc_applied[0] = 0.0
        arm.forward()
        a, r, t = (np.cumsum(x) for x in (angles, rates, arm.data.qacc[1:4]))
        rows.append(base_columns(lengths, a, r, t))
        torques.append(torque)
    columns, torque = np.array(rows), np.array(torques)
    weight = 1.0 / np.array([60e3, 25e3, 10e3])[None, :, None]
    flat = (columns * weight).reshape(-1, columns.shape[-1])
    fit = np.linalg.lstsq(flat, (torque[..., None] * weight).reshape(-1), rcond=None)[0]
    left = np.sqrt(np.mean((columns @ fit - torque) ** 2, axis=0))
    names = [f"{joint}.{symbol}" for joint in JOINTS for symbol in SYMBOLS]
    return dict(zip(names, fit.tolist(), strict=True)), left


def _state(specimen: Specimen, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Angles within the working range, rates and torques of typical size (balanced about gravity's by hand)."""
    low, high = np.radians([specimen.sheet.links[j].range_deg for j in JOINTS]).T
    angles = low + (high - low) * rng.uniform(0.1, 0.9, 3)
    rates = rng.normal(0.0, (0.12, 0.18, 0.3))
    a = np.cumsum(angles)
    columns = base_columns(tuple(specimen.lengths[j] for j in JOINTS), a, np.zeros(3), np.zeros(3))
    params = links_parameters(specimen)
    gravity = columns @ np.array([params[f"{j}.{s}"] for j in JOINTS for s in SYMBOLS])
    return angles, rates, gravity + rng.normal(0.0, (4e3, 2e3, 700.0))


def body_numbers(body: Body) -> dict[str, object]:
    """A body for the truth file."""
    return {"mass": body.mass, "centre": list(body.centre), "inertia": body.inertia}
