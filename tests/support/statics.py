"""Hand statics of the 20 t excavator: an arm held still, its cylinder forces by virtual work from the pins of the
machine file. Knows nothing of the estimator: plain trigonometry, torques as slopes of the energy, levers as slopes of
the lengths."""

import tomllib
from math import pi
from pathlib import Path

import numpy as np

FILE = tomllib.loads((Path(__file__).resolve().parents[2] / "config/excavator_20t.toml").read_text())
LINKS, TOOL = FILE["links"], FILE["tool"]["point_m"]
BODIES = {name: k for k, name in enumerate(("chassis", "boom", "stick", "bucket"))}
G, H = 9.80665, 1e-6  # m/s^2; rad or m of a slope
BACK = 15e5  # Pa on the side of a cylinder that does not push


def turned(angle, x, z):
    """A vector (x, z) turned by an angle from x towards z."""
    return np.array([np.cos(angle) * x - np.sin(angle) * z, np.sin(angle) * x + np.cos(angle) * z])


def place(theta, body, at, pitch=0.0):
    """The point `at` of a body (0: chassis), seen from the boom pin, x level and z up."""
    found, angle = np.zeros(2), pitch
    for link in range(body):
        angle += theta[link]
        found = found + (turned(angle, *at) if link == body - 1 else turned(angle, LINKS[link]["length_m"], 0.0))
    return found if body else turned(pitch, *at)


def pin(theta, at):
    return place(theta, BODIES[at["body"]], at["at_m"])


def length(theta, cylinder):
    """From the foot to the eye; of a four-bar linkage the eye is where rocker and link meet (law of cosines)."""
    linkage = cylinder["linkage"]
    foot = pin(theta, linkage["foot"])
    if linkage["kind"] == "triangle":
        return np.hypot(*(pin(theta, linkage["eye"]) - foot))
    rocker, link = pin(theta, linkage["rocker_pin"]), pin(theta, linkage["link_pin"])
    base, a, b = np.hypot(*(link - rocker)), linkage["rocker_m"], linkage["link_m"]
    corner = np.arccos((base**2 + a**2 - b**2) / (2 * base * a))
    direction = np.arctan2(*(link - rocker)[::-1]) + (corner if linkage["side"] == "left" else -corner)
    return np.hypot(*(rocker + turned(direction, a, 0.0) - foot))


def energy(theta, pitch, load, force, g=G):
    """Potential energy [J] of links and load (kg, x, z in the bucket), less the work of a force on the teeth.

    g: gravity [m/s^2]
    """
    masses = [(link["mass_kg"], k, link["centre_m"]) for k, link in enumerate(LINKS, 1)]
    weights = [(load[0], 3, load[1:]), *masses]
    lifted = sum(kg * g * place(theta, body, at, pitch)[1] for kg, body, at in weights)
    return lifted - np.dot(force, place(theta, 3, TOOL, pitch))


def slope(function, theta):
    """Its derivatives (3,) with respect to the joint angles."""
    steps = H * np.eye(3)
    return np.array([(function(theta + step) - function(theta - step)) / (2 * H) for step in steps])


def torques(theta, pitch=0.0, load=(0.0, 0.0, 0.0), force=(0.0, 0.0), g=G):
    """What the cylinders must supply at every joint (3,) [N m].

    g: gravity [m/s^2]
    """
    return slope(lambda t: energy(t, pitch, load, force, g), theta)


def pressures(theta, torque):
    """Pressures [Pa] that give those torques, by name of the signal; each joint has one cylinder."""
    found = {}
    for j, cylinder in enumerate(FILE["cylinders"]):
        head, less = (cylinder.get("count", 1) * pi / 4 * (cylinder[k] / 1e3) ** 2 for k in ("bore_mm", "rod_mm"))
        push, rod = torque[j] / slope(lambda t, c=cylinder: length(t, c), theta)[j], head - less
        low, high = (push + BACK * rod) / head, BACK
        if low < BACK:
            low, high = BACK, (BACK * head - push) / rod
        found[f"{cylinder['name']}_head_pressure"], found[f"{cylinder['name']}_rod_pressure"] = low, high
    return found


def moments():
    """First moments and inertia of the data sheet: (X, Z, J) by name of the link, what hangs beyond at its outer
    pin."""
    found, beyond = {}, 0.0
    for link in reversed(LINKS):
        (x, z), kg, far = link["centre_m"], link["mass_kg"], link.get("length_m", 0.0)
        inertia = link["inertia_kg_m2"] + kg * (x**2 + z**2) + beyond * far**2
        found[link["name"]] = (kg * x + beyond * far, kg * z, inertia)
        beyond += kg
    return found
