"""Changes in words that an owner understands."""

from math import degrees

from cylforce.effects.friction.coulomb_friction import CoulombFriction
from cylforce.effects.friction.friction_level_change import FrictionLevelChange
from cylforce.effects.loads.extra_mass import ExtraMass
from cylforce.effects.sensors.angle_offset import AngleOffset
from cylforce.effects.sensors.pressure_offset import PressureOffset
from cylforce.fleet.causes import UNKNOWN
from cylforce.fleet.changes import MachineChange, Shape

FRICTION = FrictionLevelChange().about.name
DRY, ZERO = CoulombFriction().about.name, PressureOffset().about.name
ANGLE, MASS = AngleOffset().about.name, ExtraMass().about.name
HINTS = {
    FRICTION: "seal, guide or grease?",
    DRY: "seal, guide or grease?",
    ZERO: "pressure sensor?",
    ANGLE: "sensor slipped, or mounted anew?",
    MASS: "something mounted, taken off, or mud?",
    UNKNOWN: "ask `cylforce gap` with recordings of before and after",
}


def cause_words(name: str, at: str) -> str:
    """Return a cause and its location in words."""
    said = {
        FRICTION: f"{at} cylinder's friction",
        DRY: f"{at} cylinder's dry friction",
        ZERO: f"zero of the {at} cylinder's pressures",
        ANGLE: f"zero of {at}",
        MASS: f"mass on the {at}",
        UNKNOWN: "something that none of the known causes explains",
    }
    return said[name]


def size_words(altered: MachineChange) -> str:
    """Return size and standard error in the units of the workshop."""
    value, error = altered.size, altered.error
    if altered.name == UNKNOWN:
        return ""
    if altered.name == FRICTION:
        return f"{100.0 * value:+.0f} % (± {100.0 * error:.0f})"
    if altered.name == ZERO:
        return f"{value / 1e5:+.2f} bar (± {error / 1e5:.2f})"
    if altered.unit.startswith("rad"):
        return f"{degrees(value):+.2f} deg (± {degrees(error):.2f})"
    if altered.unit == "m":
        return f"{1e3 * value:+.1f} mm (± {1e3 * error:.1f})"
    return f"{value:+.3g} {altered.unit} (± {error:.2g})"


def told(altered: MachineChange, date: str, before: str) -> str:
    """Return a sentence about a change.

    date:   of the first recording with it
    before: date of the recording before
    """
    what = " ".join((cause_words(altered.name, altered.at), size_words(altered))).strip()
    others = [cause_words(b.name, b.at) for b in altered.causes if (b.name, b.at) != (altered.name, altered.at)]
    sure = f"{100.0 * min(altered.probability, 0.999):.3g} % sure"
    also = f"; may also be the {', the '.join(others)}" if others else ""
    if altered.shape is Shape.DAY:
        return f"on {date} alone: {what}: another load, tool or place? ({sure}{also})"
    since = f"growing since {before or date}" if altered.shape is Shape.SLOPE else f"since {date}"
    since += ", or growing" if altered.may_grow else ""
    return f"{what} {since}: {HINTS[altered.name]} ({sure}{also})"
