"""Every effect in the words of a service engineer: what is wrong, how much, in units of every day. Pure."""

from typing import Any, NamedTuple

import numpy as np

from cylforce.diagnosis.search import NO_GAP, UNKNOWN
from cylforce.mechanics.machine import Machine
from cylforce.signals.kinds import Kind, Signal

WORKING_SPEED = 0.1  # m/s, at which a friction that grows with speed is told: a cylinder at work; convention
WORKING_TORQUE = 1e5  # N m, at which a bend is told; convention
SENSORS = {
    Kind.HEAD_PRESSURE: "the head-side pressure sensor of the {} cylinder",
    Kind.ROD_PRESSURE: "the rod-side pressure sensor of the {} cylinder",
    Kind.FORCE_PIN: "the force pin of the {} cylinder",
    Kind.CYLINDER_LENGTH: "the length sensor of the {} cylinder",
    Kind.JOINT_ANGLE: "the angle sensor of the {}",
    Kind.LINK_INCLINATION: "the inclination sensor of the {}",
}
ON_CYLINDERS = (Kind.HEAD_PRESSURE, Kind.ROD_PRESSURE, Kind.FORCE_PIN, Kind.CYLINDER_LENGTH)


class Words(NamedTuple):
    """What is wrong, `{}` the place; what a size above and below zero means; whether it sits at a `cylinder`."""

    wrong: str
    more: str = ""
    less: str = ""
    cylinder: bool = False


HIGH, LOW = "too high", "too low"
# What a machine is compared with, by `compared_with` of the answer: only references were recorded before.
THAN = {
    "references": "than before",
    "simulation": "than in the simulation",
    "identification": "than identified",
    "data_sheet": "than on its data sheet",
}
BEFORE = THAN["references"]
MORE, LESS = "more {}", "less {}"
WORDS: dict[str, Words] = {
    "coulomb_friction": Words("changed dry friction in {}", MORE, LESS, cylinder=True),
    "viscous_friction": Words("changed friction with speed in {}", MORE, LESS, cylinder=True),
    "friction_level_change": Words("changed friction as a whole in {}", MORE, LESS, cylinder=True),
    "stribeck": Words("extra friction at creeping speed in {}", cylinder=True),
    "load_dependent_friction": Words(
        "changed friction under load in {}",
        "of the cylinder's force more {}",
        "of the cylinder's force less {}",
        cylinder=True,
    ),
    "asymmetric_friction": Words("friction that changed in one direction of {}", MORE, LESS, cylinder=True),
    "presliding_hysteresis": Words("friction just after turning back in {}", cylinder=True),
    "friction_temperature_drift": Words("friction that changes as the oil warms in {}", cylinder=True),
    "return_line_loss": Words("pressure lost in the hydraulic line of {}", MORE, LESS, cylinder=True),
    "pin_friction": Words("friction of the pin of the {} joint"),
    "counterbalance_pressure": Words("braking by the load-holding valve in {}", MORE, LESS, cylinder=True),
    "end_cushion": Words("braking at the end of the stroke of {}", cylinder=True),
    "pressure_offset": Words("a wrong zero of {}", HIGH, LOW),
    "pressure_gain": Words("a wrong scale of {}", HIGH, LOW),
    "pressure_drift": Words("a drifting zero of {}", "up", "down"),
    "pressure_zero_settling": Words("a zero of {} that settles after the start", HIGH, LOW),
    "pressure_sensor_hysteresis": Words("readings that lag behind a changing pressure at {}"),
    "angle_offset": Words("a wrong zero of {}", HIGH, LOW),
    "angle_scale": Words("a wrong scale of {}", HIGH, LOW),
    "encoder_eccentricity": Words("an encoder off its axis at {}"),
    "sensor_delay": Words("late readings of {}"),
    "intermittent_glitch": Words("readings that jump for moments at {}"),
    "tilt_ignored": Words("a tilt of {} that is not measured rightly"),
    "linkage_geometry": Words("a pin or bar of the {} linkage that is not where the machine file has it"),
    "extra_mass": Words("extra mass on the {}"),
    "first_moment_change": Words("a shifted centre of gravity of the {}", "outwards", "inwards"),
    "mud": Words("mass that builds up on the {}, such as mud"),
    "hose_spring": Words("hoses that pull like a spring at the {} joint"),
    "compliance": Words("a bending {} under load"),
    "ringing_compliance": Words("a springy {} that swings after starts and stops"),
    "backlash": Words("play in the {} joint"),
    "soil_contact": Words("contact of the {} with the ground or an obstacle"),
    "slew_centrifugal": Words("turning of the house that no sensor measures"),
    "boom_motion": Words("movement of what carries the first link"),
    "soft_ground": Words("soft ground under {}, which rocks with its arm"),
    "payload_spill": Words("load falling out of the {}", less="less"),
    "payload_shift": Words("load moving in the {}"),
    "clock_fault": Words("pressures and angles that were recorded on different clocks"),
    NO_GAP[0]: Words("nothing: the machine is in order"),
    UNKNOWN[0]: Words("something that is none of the known faults"),
}
# SI unit of a size: the unit that is told, and what of it makes one SI unit.
TOLD: dict[str, tuple[str, float]] = {
    "N": ("N", 1.0),
    "N s/m": (f"N at {WORKING_SPEED:g} m/s", WORKING_SPEED),
    "Pa": ("bar", 1e-5),
    "Pa/h": ("bar an hour", 1e-5),
    "rad": ("degrees", float(np.degrees(1.0))),
    "m": ("mm", 1e3),
    "s": ("ms", 1e3),
    "kg": ("kg", 1.0),
    "kg m": ("kg m", 1.0),
    "1": ("%", 1e2),
    "N m/rad": ("N m a degree", float(np.radians(1.0))),
    "rad/(N m)": (f"degrees at {WORKING_TORQUE / 1e3:.0f} kN m", WORKING_TORQUE * float(np.degrees(1.0))),
}
STATED_AT = {"return_line_loss": "at 0.3 m/s", "end_cushion": "at 0.1 m/s", "mud": "after ten minutes"}  # their sizes
SILENT = ("soil_contact", "slew_centrifugal", "boom_motion")  # their size is that of many moments, or of a lever


def fault(machine: Machine, name: str, at: str) -> str:
    """What is wrong: an effect at its place as a noun with all it needs. An effect of the user's own: its name."""
    words = WORDS.get(name)
    if words is None:
        return f"{name.replace('_', ' ')} at {place(machine, at)}"
    return words.wrong.format(cylinder(at) if words.cylinder else place(machine, at))


def happening_beside(machine: Machine, seconds: float, incident: tuple[str, str] | None) -> str:
    """Return a sentence on what happens in some blocks beside the cause; empty where nothing does.

    seconds:  of these blocks
    incident: name and place; None of something that healthy machines do, too
    """
    if not seconds:
        return ""
    if incident is None:
        return f"for about {seconds:.0f} s something everyday happens: this time does not count"
    return (
        f"for about {seconds:.0f} s something happens, most probably {fault(machine, *incident)}: what is wrong "
        "besides was looked for beside it"
    )


def cylinder(at: str) -> str:
    """A cylinder, or all of them."""
    return "all cylinders" if at == "machine" else f"the {at} cylinder"


def place(machine: Machine, at: str) -> str:
    """A sensor as a mechanic calls it; other places by their names."""
    signal = _signal(machine, at)
    if signal is None or signal.kind not in SENSORS:
        return "the machine" if at == "machine" else at
    parts = machine.cylinders if signal.kind in ON_CYLINDERS else machine.links
    return SENSORS[signal.kind].format(parts[signal.index].name)


def _signal(machine: Machine, at: str) -> Signal | None:
    return next((signal for signal in machine.signals if signal.name == at), None)


def amount(machine: Machine, effect: dict[str, Any], than: str = BEFORE) -> str:
    """How much, and between which bounds with 90 %; nothing for what has no size that says something. `than`: what the
    machine is compared with."""
    size, unit = effect["parameters"]["size"], effect["parameters"]["size"]["unit"]
    if effect["name"] in SILENT or "sensors" in effect:  # of clocks, it is said when they are how far apart
        return ""
    told, factor = _told(machine, effect, unit)
    value, low, high = (size[key] * factor for key in ("value", "low", "high"))
    words = WORDS.get(effect["name"], Words(""))
    way = (words.more if value > 0.0 else words.less).format(than)
    if way and value < 0.0:
        value, low, high = -value, -high, -low
    ways = {1.0: ", while it extends", -1.0: ", while it retracts"}
    only = ways.get(float(effect["shape"].get("way", 0.0)), "") if effect["name"] == "asymmetric_friction" else ""
    return f"{number(value)} {told} {way}".rstrip() + f" (90 % sure: {number(low)} to {number(high)}){only}"


def _told(machine: Machine, effect: dict[str, Any], unit: str) -> tuple[str, float]:
    if unit == "rad (m)":
        signal = _signal(machine, effect["at"])
        unit = "m" if signal is not None and signal.kind is Kind.CYLINDER_LENGTH else "rad"
    if effect["name"] in STATED_AT:
        unit, factor = TOLD[unit]
        return f"{unit} {STATED_AT[effect['name']]}", factor
    return TOLD.get(unit, (unit, 1.0))


def number(value: float) -> str:
    """Three digits, no power of ten."""
    return f"{float(f'{value:.3g}'):.0f}" if abs(value) >= 100.0 else f"{value:.3g}"
