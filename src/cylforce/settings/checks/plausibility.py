"""Check whether an arm can be built, and whether it resembles the arm of a construction machine.

These checks need several values at once. An impossible value is an error, an unusual one a warning. Each names the
value and its check.

A limit that has no other source is a ratio of the data sheets of excavators (0.8 to 100 t), wheel loaders and loader
cranes, with room on both sides. Ratios do not depend on the machine's size, so they detect errors of unit and of sign
that the limits of single values let pass.

In every check `findings` collects the errors and warnings. Numbers in the machine file: `j` of a link and the joint at
its inner pin, `c` of a cylinder, `k` of a signal or attachment.
"""

import numpy as np

from cylforce.mechanics.machine import TOLERANCE_OVER_ERROR, Machine
from cylforce.settings.checks.readings import check_signal
from cylforce.settings.checks.strokes import check_cylinder
from cylforce.settings.error import FaultError, Inspection, Key
from cylforce.signals.units import BAR, DEGREE, STANDARD_GRAVITY

# (refused below, warned below, warned above, refused above)
Limits = tuple[float, float, float, float]
# kg/m: a steel tube of 40 x 3 mm has 2.7; mini excavators begin at 40; the booms of 300 t machines have about 3000
MASS_PER_LENGTH: Limits = (2.0, 15.0, 5000.0, 30_000.0)
# I / (m l^2) about the centre of gravity: 1/12 for a slender rod, 1/4 with all mass at both ends, 1/3 for a rod about
# its pin, which is the wrong axis
GYRATION: Limits = (0.002, 0.02, 0.3, 1.0)
# distance of the centre of gravity from the inner pin over the length: 0.3 to 0.6 as a rule
CENTRE: Limits = (0.0, 0.02, 1.2, 2.0)
# rated payload over the mass of the arm: 0.3 to 1.5
PAYLOAD: Limits = (0.005, 0.03, 5.0, 50.0)
# tooth line over the longest other link: 0.2 to 1.2
TOOL: Limits = (0.0, 0.0, 2.0, 20.0)
# degrees; a joint's whole range is 60 to 200; one that is given in radians is below 5
ANGLE_SPAN: Limits = (5.0, 20.0, 270.0, 360.0)
# bar to hold the rated payload at full reach, by a cylinder at its best lever: relief valves open at 210 to 380, and
# makers keep a reserve of a fifth
HOLDING: Limits = (1.0, 8.0, 300.0, 700.0)
# rod over bore: ISO 7181 has area ratios from 1.06 to 5; cylinders of mobile machines have 1.4 to 2.5, a rod of 0.53 to
# 0.77 of the bore. A radius that is taken for a diameter falls outside.
ROD: Limits = (0.1, 0.4, 0.85, 0.98)
PIN_REACH = 1.5  # largest distance of a pin from the inner pin, times the link's length (a stick's tail is 0.3 long)
CHASSIS_REACH = 10.0  # m, of a pin on the house; the house may include a boom that stands still, 10 m long
CENTRE_TOLERANCE = 0.4  # tolerance beyond which the centre could be anywhere on the link, times its length


def inspect_machine(machine: Machine) -> Inspection:
    """Return everything that is impossible (`errors`) or unusual (`warnings`) about a machine; keys are those of its
    file.
    """
    findings = Inspection()
    for j in range(machine.size):
        _check_link(machine, j, findings)
    for c in range(len(machine.cylinders)):
        check_cylinder(machine, c, findings)
        _check_pins(machine, c, findings)
        _check_rod(machine, c, findings)
    _check_load(machine, findings)
    _check_drive(machine, findings)
    for k in range(len(machine.signals)):
        check_signal(machine, k, findings)
    return findings


def inspect_attachment(machine: Machine, standard: Machine, k: int) -> Inspection:
    """Return the errors and warnings of a machine with attachment k that the standard one does not have."""
    with_standard, with_attachment, findings = inspect_machine(standard), inspect_machine(machine), Inspection()
    for faults, known, new in (
        (with_attachment.errors, with_standard.errors, findings.errors),
        (with_attachment.warnings, with_standard.warnings, findings.warnings),
    ):
        old = {(fault.key, str(fault)) for fault in known}
        new.extend(_of_attachment(fault, machine, k) for fault in faults if (fault.key, str(fault)) not in old)
    return findings


def _of_attachment(fault: FaultError, machine: Machine, k: int) -> FaultError:
    """Return a fault at the attachment's own key; one of a cylinder or joint is a fault of the whole attachment."""
    own_key, last_link = ("attachments", k), ("links", machine.size - 1)
    if fault.key[:2] == last_link:
        return FaultError((*own_key, *fault.key[2:]), str(fault))
    if fault.key[0] in ("tool", "machine"):
        return FaultError((*own_key, *fault.key[1:]), str(fault))
    part = machine.cylinders[int(fault.key[1])].name if fault.key[0] == "cylinders" else str(fault.key[0])
    return FaultError(own_key, f"does not suit the arm: {part} {fault}")


def _judge(findings: Inspection, key: Key, value: float, limits: Limits, problem: str) -> None:
    """Add an error to `findings` when a value is beyond its outer limits, a warning beyond the inner ones.

    key: key of the file to which the finding belongs
    value: ratio or quantity, in the unit of its limits
    problem: sentence of the finding
    """
    refuse_low, warn_low, warn_high, refuse_high = limits
    if not refuse_low <= value <= refuse_high:
        findings.refuse(key, problem)
    elif not warn_low <= value <= warn_high:
        findings.warn(key, problem)


def _check_link(machine: Machine, j: int, findings: Inspection) -> None:
    """Check a link's mass, centre of gravity, inertia and tolerance of the centre against its length; and how far its
    joint turns.
    """
    link, key = machine.links[j], ("links", j)
    length = max(link.length, 1e-9)
    line = link.mass / length
    problem = f"is {link.mass:g} on a length of {length:g} m, {line:.3g} kg/m; arms have 15 to 5000: check both"
    _judge(findings, (*key, "mass_kg"), line, MASS_PER_LENGTH, problem)
    distance = abs(complex(link.cx, link.cz)) / length
    problem = f"is {distance:.2g} of the length away from the inner pin; links have 0.3 to 0.6: check sign and unit"
    _judge(findings, (*key, "centre_m"), distance, CENTRE, problem)
    if link.cx < 0.0 and distance >= CENTRE[1]:
        findings.warn((*key, "centre_m"), f"has x = {link.cx:g} m, behind the inner pin: check its sign")
    gyration = link.inertia / (link.mass * length**2)
    problem = (
        f"is {link.inertia:g}, {gyration:.2g} m l^2; links have 0.06 to 0.2 about their centre of gravity "
        "(not about the pin): check it"
    )
    _judge(findings, (*key, "inertia_kg_m2"), gyration, GYRATION, problem)
    _check_range(machine, j, findings)
    if link.centre_error * TOLERANCE_OVER_ERROR > CENTRE_TOLERANCE * length:
        half = link.centre_error * TOLERANCE_OVER_ERROR
        findings.warn((*key, "tolerance", "centre_m"), f"is {half:g} on a length of {length:g} m: check the unit")


def _check_range(machine: Machine, j: int, findings: Inspection) -> None:
    """Check how far a joint turns, and whether its range seems to be in radians."""
    link = machine.links[j]
    low, high = link.angle_low / DEGREE, link.angle_high / DEGREE
    problem = f"spans {high - low:.3g} degrees, joints have 20 to 270: check it"
    if high - low > ANGLE_SPAN[3]:
        problem = f"is [{low:g}, {high:g}] and spans more than a turn: give the joint's mechanical range"
    elif high - low < 2.0 * np.pi and max(abs(low), abs(high)) <= 2.0 * np.pi:
        problem = f"is [{low:g}, {high:g}], {high - low:.3g} degrees: these look like radians, write degrees"
    _judge(findings, ("links", j, "angle_range_deg"), high - low, ANGLE_SPAN, problem)


def _check_pins(machine: Machine, c: int, findings: Inspection) -> None:
    """Warn of a cylinder's pin too far from the origin of its body.

    That is PIN_REACH times the length of its link, or CHASSIS_REACH on the chassis.
    """
    for body, at in machine.cylinders[c].linkage.pins:
        name = machine.links[body - 1].name if body else "chassis"
        reach = PIN_REACH * machine.links[body - 1].length if body else CHASSIS_REACH
        if abs(at) > reach:
            problem = f"has a pin {abs(at):.2f} m away from the origin of {name}, expected are {reach:.2g} at most"
            findings.warn(("cylinders", c, "linkage"), f"{problem}: check at_m = [{at.real:g}, {at.imag:g}]")


def _check_load(machine: Machine, findings: Inspection) -> None:
    """Check the rated payload against the arm's mass, the tool against its other links, and the payload's reach against
    the tool.
    """
    mass = sum(link.mass for link in machine.links)
    share = machine.rated_payload / mass
    problem = (
        f"is {machine.rated_payload:g}, {share:.2g} times the arm's mass of {mass:.0f} kg; machines have 0.3 to 1.5"
    )
    _judge(findings, ("machine", "rated_payload_kg"), share, PAYLOAD, f"{problem}: check both")
    tool = machine.tool
    others = [link.length for link in machine.links[:-1]]
    if others:
        ratio = abs(tool) / max(others)
        problem = f"is {abs(tool):g} m away from the last pin, {ratio:.2g} times the longest other link: check the unit"
        _judge(findings, ("tool", "point_m"), ratio, TOOL, problem)
    if tool.real < 0.0:
        findings.warn(("tool", "point_m"), f"has x = {tool.real:g} m, behind the last pin: check its sign")
    if machine.payload_reach > 3.0 * abs(tool):
        problem = f"is {machine.payload_reach:g}, over three times as far as the tooth line: check it"
        findings.warn(("machine", "payload_reach_m"), problem)


def _check_drive(machine: Machine, findings: Inspection) -> None:
    """Check that each joint has a cylinder, and one of the right size."""
    for j, link in enumerate(machine.links):
        acting = [c for c, span in enumerate(machine.spans) if j in span]
        if not acting:
            findings.warn(
                ("links", j), f"is moved by no cylinder: check the bodies of the pins, or add one at {link.name}"
            )
        # The size can be checked where one cylinder alone carries the load. One that acts on two joints (a tilt
        # cylinder at the lift arm) adds little; of two cylinders that act on this joint only, each carries a part.
        single = [c for c in acting if machine.spans[c] == (j,)]
        if len(single) == 1:
            _check_holding_pressure(machine, j, single[0], findings)


def _check_rod(machine: Machine, c: int, findings: Inspection) -> None:
    """Check a cylinder's rod against its bore."""
    cylinder = machine.cylinders[c]
    ratio = float(np.sqrt(max(0.0, 1.0 - cylinder.area_rod / cylinder.area_head)))
    problem = f"is {ratio:.2g} times bore_mm, cylinders have 0.5 to 0.8: check both (diameters, not radii)"
    _judge(findings, ("cylinders", c, "rod_mm"), ratio, ROD, problem)


def _check_holding_pressure(machine: Machine, j: int, c: int, findings: Inspection) -> None:
    """Check the pressure that a cylinder needs to hold the rated payload at full reach: on its head side, in bar.

    A cylinder whose linkage closes nowhere has no lever: its pressure is infinite and not judged. `check_cylinder`
    reports the linkage.
    """
    pressure = _holding_pressure(machine, j, c) / BAR
    if np.isfinite(pressure):
        problem = (
            f"needs at least {pressure:.0f} bar to carry the rated payload at full reach; machines have 20 to 300: "
            "check bore_mm, count, the pins, masses and payload"
        )
        _judge(findings, ("cylinders", c), pressure, HOLDING, problem)


def _holding_pressure(machine: Machine, j: int, c: int) -> float:
    """Return the pressure p = g sum(m x) / (r A) [Pa] on the head side of a cylinder that holds the rated payload.

    The arm beyond joint j is stretched out and level, with x the distances from that joint. The lever r is the largest
    over the joint's range, so that p is the least that is needed. Infinite where there is no lever.
    """
    theta = np.zeros((181, machine.size))
    theta[:, j] = np.linspace(machine.links[j].angle_low, machine.links[j].angle_high, 181)
    lever = np.abs(machine.geometry(theta).lever[:, c, j])
    pin, moment = 0.0, 0.0
    for k, link in enumerate(machine.links[j:], j):
        moment += link.mass * (pin + link.cx)
        pin += link.length if k + 1 < machine.size else 0.0
    moment += machine.rated_payload * (pin + machine.payload_reach)
    largest = float(np.nanmax(lever, initial=0.0))
    return STANDARD_GRAVITY * moment / (largest * machine.cylinders[c].area_head) if largest > 0.0 else np.inf
