"""Check whether a sensor's range and name fit its quantity, and the joint or cylinder on which it is mounted."""

from cylforce.mechanics.machine import Machine
from cylforce.mechanics.unwrapping import inclinations
from cylforce.settings.checks.names import AT_CYLINDER, AT_LINK
from cylforce.settings.error import Inspection, Key
from cylforce.signals.kinds import Kind, Signal
from cylforce.signals.turns import is_circle
from cylforce.signals.units import BAR, DEGREE, MILLIMETRE

# Greatest less least value (refused below, warned below, warned above, refused above), in SI.
SPANS: dict[Kind, tuple[float, float, float, float]] = {
    # transmitters for mobile hydraulics end at 250, 400 or 600 bar
    Kind.HEAD_PRESSURE: (10 * BAR, 90 * BAR, 700 * BAR, 3000 * BAR),
    Kind.ROD_PRESSURE: (10 * BAR, 90 * BAR, 700 * BAR, 3000 * BAR),
    # a cylinder of 60 mm pushes 70 kN at 250 bar, one of 300 mm 2.5 MN
    Kind.FORCE_PIN: (1e3, 2e4, 1e7, 1e9),
    Kind.JOINT_ANGLE: (2 * DEGREE, 10 * DEGREE, 400 * DEGREE, 800 * DEGREE),
    Kind.LINK_INCLINATION: (2 * DEGREE, 20 * DEGREE, 400 * DEGREE, 800 * DEGREE),
    Kind.CYLINDER_LENGTH: (20 * MILLIMETRE, 0.1, 7.0, 30.0),
    # a machine stands on slopes of up to 30 degrees; inclinometers reach 180 to either side
    Kind.PITCH: (2 * DEGREE, 10 * DEGREE, 360 * DEGREE, 800 * DEGREE),
    Kind.ROLL: (2 * DEGREE, 10 * DEGREE, 360 * DEGREE, 800 * DEGREE),
    # gyros span 100 to 2000 degrees a second, accelerometers 2 to 16 g to either side
    Kind.PITCH_RATE: (2 * DEGREE, 40 * DEGREE, 4000 * DEGREE, 12000 * DEGREE),
    Kind.FORWARD_ACCELERATION: (1.0, 10.0, 320.0, 3200.0),
    Kind.UPWARD_ACCELERATION: (1.0, 10.0, 320.0, 3200.0),
    # houses slew at up to 12 turns a minute, 72 degrees a second
    Kind.SLEW_RATE: (2 * DEGREE, 40 * DEGREE, 2000 * DEGREE, 6000 * DEGREE),
    Kind.SLEW_ANGLE: (2 * DEGREE, 90 * DEGREE, 1e5 * DEGREE, 1e9),
    Kind.OIL_TEMPERATURE: (5.0, 50.0, 300.0, 1000.0),
}
COVERED = 0.5  # share of the joint's or the cylinder's range that a sensor must cover at least; chosen
SLACK = 0.02  # share of that range by which a sensor's range may end within it; chosen
NOISE_WARN, NOISE_REFUSE = 0.02, 0.25  # standard error over span: class 1 sensors have 0.005 at most
SIDES = {Kind.HEAD_PRESSURE: ("head", "rod"), Kind.ROD_PRESSURE: ("rod", "head")}
UNITS = {"Pa": (BAR, "bar"), "rad": (DEGREE, "deg"), "rad/s": (DEGREE, "deg/s")}


def check_signal(machine: Machine, k: int, findings: Inspection) -> None:
    """Check a sensor: span of its range, noise, what the range covers, and name.

    Refuses or warns of a span beyond the limits of SPANS.
    """
    signal, key = machine.signals[k], ("sensors", k)
    span = signal.high - signal.low
    refuse_low, warn_low, warn_high, refuse_high = SPANS[signal.kind]
    typical = f"sensors of {signal.kind} span {_shown(signal, warn_low)} to {_shown(signal, warn_high)}"
    problem = f"spans {_shown(signal, span)}, {typical}: check value and unit"
    if not refuse_low <= span <= refuse_high:
        findings.refuse((*key, "range"), problem)
    elif not warn_low <= span <= warn_high:
        findings.warn((*key, "range"), problem)
    _check_noise(signal, key, findings)
    _check_cover(machine, signal, key, findings)
    _check_name(machine, signal, key, findings)


def _check_noise(signal: Signal, key: Key, findings: Inspection) -> None:
    """Check a sensor's standard error, over the span of its range: NOISE_REFUSE refuses, NOISE_WARN warns."""
    share = signal.standard_error / (signal.high - signal.low)
    problem = (
        f"is {_shown(signal, signal.standard_error)}, {100 * share:.2g} % of the range: check its unit, or the scale"
    )
    if share > NOISE_REFUSE:
        findings.refuse((*key, "standard_error"), problem)
    elif share > NOISE_WARN:
        findings.warn((*key, "standard_error"), problem)


def _check_cover(machine: Machine, signal: Signal, key: Key, findings: Inspection) -> None:
    """Check that a sensor of angle or length covers the whole range of its joint or cylinder.

    Refuses one that covers less than COVERED of it, warns of one whose range ends within it by more than SLACK. A
    sensor of a whole circle covers every angle. An inclinometer gets a warning only.
    """
    if signal.kind in AT_LINK and is_circle(signal.low, signal.high):
        return
    if signal.kind is Kind.LINK_INCLINATION:
        _check_inclination(machine, signal, key, findings)
        return
    if signal.kind is Kind.JOINT_ANGLE:
        link = machine.links[signal.index]
        low, high, limits = link.angle_low, link.angle_high, f"{link.name}'s angle_range_deg"
    elif signal.kind is Kind.CYLINDER_LENGTH:
        cylinder = machine.cylinders[signal.index]
        low, high, limits = cylinder.length_low, cylinder.length_high, f"{cylinder.name}'s length_range_m"
    else:
        return
    covered = min(high, signal.high) - max(low, signal.low)
    problem = (
        f"is {_shown(signal, signal.low)} to {_shown(signal, signal.high)}, {limits} {_shown(signal, low)} to "
        f"{_shown(signal, high)}: the sensor must see all of it; check sign, unit and offset"
    )
    if covered < COVERED * (high - low):
        findings.refuse((*key, "range"), problem)
    elif max(signal.low - low, high - signal.high) > SLACK * (high - low):
        findings.warn((*key, "range"), problem)


def _check_inclination(machine: Machine, signal: Signal, key: Key, findings: Inspection) -> None:
    """Warn of an inclinometer whose range ends within that of the link's inclination, by more than SLACK of it.

    The inclination is that on level ground, which the ranges of the link's joint and of those before it allow.
    """
    low, high = inclinations(machine, signal.index)
    if max(signal.low - low, high - signal.high) <= SLACK * (high - low):
        return
    name = machine.links[signal.index].name
    findings.warn(
        (*key, "range"),
        f"is {_shown(signal, signal.low)} to {_shown(signal, signal.high)}, the {name}'s inclination on level ground "
        f"{_shown(signal, low)} to {_shown(signal, high)} by angle_range_deg of the links: nothing is measured beyond "
        "the range; give a 360 degree sensor its whole circle, or use an encoder on the pin",
    )


def _check_name(machine: Machine, signal: Signal, key: Key, findings: Inspection) -> None:
    """Warn of a name that contains another side or location than the sensor's own."""
    words = signal.name.lower().split("_")
    side, other = SIDES.get(signal.kind, ("", ""))
    if other in words and side not in words:
        findings.warn(
            (*key, "kind"), f"is {signal.kind}, but its name says {other}: exchange head and rod, or rename it"
        )
    if signal.kind not in AT_CYLINDER + AT_LINK:
        return
    names = [part.name for part in (machine.cylinders if signal.kind in AT_CYLINDER else machine.links)]
    named = [name for name in names if name.lower() in words]
    if named and names[signal.index] not in named:
        findings.warn((*key, "at"), f"is {names[signal.index]}, but its name says {named[0]}: correct one of them")


def _shown(signal: Signal, value: float) -> str:
    """Return a value [SI] of a signal in words, in the unit in which sensors are specified, such as bar."""
    size, unit = UNITS.get(signal.unit, (1.0, signal.unit))
    return f"{value / size:.4g} {unit}"
