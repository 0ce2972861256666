"""The tables of a description, for the terminal and for a page."""

from collections.abc import Iterator, Sequence
from math import degrees, isfinite, isnan
from typing import NamedTuple

from cylforce.canopen.bus_load import BIT_RATES, traffic
from cylforce.mechanics.installation import Service
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.unwrapping import ends_passed
from cylforce.programs.description.arm import PRESSURE, CylinderNumbers, cylinder_numbers, extent, pin_heights
from cylforce.settings.checks.strokes import BEYOND_WARN
from cylforce.signals.kinds import Kind
from cylforce.signals.layout import CODES, TYPE_NAMES, Pdo
from cylforce.signals.units import BAR


class TextTable(NamedTuple):
    """Table of texts.

    title: its content
    head:  heads of the columns
    rows:  rows of as many texts
    notes: notes below it
    """

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    notes: Sequence[str] = ()


def tables(service: Service) -> tuple[TextTable, ...]:
    """Return all tables of a machine file."""
    machine = service.machine
    cylinders = cylinder_numbers(machine)
    return (
        _links(machine),
        _strokes(machine, cylinders),
        _levers(machine, cylinders),
        _nodes(service),
        _pdos(service),
        _bus(service),
    )


def as_text(table: TextTable) -> str:
    """Return a table as text; the first column is aligned left, other columns right if they are numbers."""
    lines = [table.head, *table.rows]
    widths = [max(len(line[k]) for line in lines) for k in range(len(table.head))]
    right = [k > 0 and all(_is_number(row[k]) for row in table.rows) for k in range(len(table.head))]
    cells = [[f"{t:>{w}}" if r else f"{t:<{w}}" for t, w, r in zip(line, widths, right, strict=True)] for line in lines]
    return "\n".join(
        [table.title, *("  " + "  ".join(line).rstrip() for line in cells), *(f"  {n}" for n in table.notes)]
    )


def _is_number(text: str) -> bool:
    try:
        return not text or isfinite(float(text))
    except ValueError:
        return False


def _links(machine: Machine) -> TextTable:
    head = ("link", "angle range [deg]", "length [m]", "mass [kg]", "centre x [m]", "centre z [m]", "inertia [kg m^2]")
    rows = [
        (
            link.name,
            f"{degrees(link.angle_low):.1f} to {degrees(link.angle_high):.1f}",
            f"{link.length:.3f}",
            f"{link.mass:.0f}",
            f"{link.cx:.3f}",
            f"{link.cz:.3f}",
            f"{link.inertia:.0f}",
        )
        for link in machine.links
    ]
    far = extent(machine)
    note = f"the tool comes {far.forward:.2f} m forward, {far.up:.2f} m up and {far.down:.2f} m down from the first pin"
    notes = [note]
    if machine.size > 1:
        low, high = pin_heights(machine)
        last = machine.links[-1].name
        notes.append(f"the {last}'s pin comes from {low:.2f} m to {high:.2f} m, counted upwards from the first pin")
    notes += _ends_passed(machine)
    return TextTable("Links", head, rows, notes)


def _ends_passed(machine: Machine) -> Iterator[str]:
    """Yield sentences on angle sensors that pass the end of their circle."""
    for passed in ends_passed(machine):
        signal = machine.signals[passed.signal]
        link = machine.links[signal.index].name
        what = f"inclination of the {link}" if signal.kind is Kind.LINK_INCLINATION else f"angle of the {link}"
        yield (
            f"{signal.name} passes the end of its circle: the {what} goes from {degrees(passed.low):.0f} to "
            f"{degrees(passed.high):.0f} deg, the sensor from {degrees(signal.low):.0f} to {degrees(signal.high):.0f}; "
            "cylforce adds the whole turns"
        )


def _strokes(machine: Machine, cylinders: Sequence[CylinderNumbers]) -> TextTable:
    head = ["cylinder", "closed [mm]", "open [mm]", "lowest angle [deg]", "length [mm]", "highest angle [deg]"]
    head += ["length [mm]", "left closed [mm]", "left open [mm]"]
    rows = [
        (
            c.name,
            *(f"{1e3 * length:.0f}" for length in (c.closed, c.opened)),
            *(t for k in (0, 2) for t in (f"{degrees(c.angle[k]):.1f}", f"{1e3 * c.length[k]:.0f}")),
            *(f"{1e3 * left:.0f}" for left in c.left),
        )
        for c in cylinders
    ]
    return TextTable(
        "Cylinder lengths at the ends of the angle ranges, and the stroke left", head, rows, _notes(machine, cylinders)
    )


def _notes(machine: Machine, cylinders: Sequence[CylinderNumbers]) -> list[str]:
    found = []
    for c in cylinders:
        if c.reaches_over:
            over = ", ".join(machine.links[i].name for i in c.reaches_over)
            name = machine.links[c.joint].name
            found.append(
                f"{c.name}: angles of the {name} from the chassis; stroke left in every position of the {over}"
            )
    return found


def _levers(machine: Machine, cylinders: Sequence[CylinderNumbers]) -> TextTable:
    head = ("cylinder", "joint", "angle [deg]", "lever [m]", "push [kN m]", "pull [kN m]")
    rows = [
        (
            c.name if k == 0 else "",
            machine.links[c.joint].name,
            f"{degrees(c.angle[k]):.1f}",
            f"{c.lever[k]:.3f}",
            f"{c.push[k] / 1e3:.1f}",
            f"{c.pull[k] / 1e3:.1f}",
        )
        for c in cylinders
        for k in range(3)
    ]
    title = f"Levers d(length)/d(angle), and torques at {PRESSURE / BAR:.0f} bar in the head or rod chamber"
    return TextTable(title, head, rows)


def _nodes(service: Service) -> TextTable:
    head = ("node", "id", "profile", "heartbeat [ms]", "signals")
    rows = [
        (
            node.name,
            str(node.node_id),
            str(node.profile or "any"),
            f"{1e3 * node.heartbeat_s:.0f}",
            ", ".join(str(field.signal) for pdo in node.pdos for field in pdo.fields if field.signal),
        )
        for node in service.nodes
    ]
    own = ("cylforce", str(service.node_id), "404", f"{1e3 * service.heartbeat_s:.0f}", "payload and force")
    return TextTable("Nodes", head, [*rows, own])


def _pdos(service: Service) -> TextTable:
    head = ("TPDO of", "no.", "COB-ID", "sent", "byte", "object", "type", "value")
    each = [(node.name, pdo) for node in service.nodes for pdo in node.pdos]
    each += [("cylforce", pdo) for pdo in service.publication]
    return TextTable("PDOs", head, [row for owner, pdo in each for row in _pdo(owner, pdo)])


def _pdo(owner: str, pdo: Pdo) -> Iterator[tuple[str, ...]]:
    nth = "every SYNC" if pdo.sync == 1 else f"every {pdo.sync}th SYNC"
    sent = nth if pdo.synchronous else f"every {1e3 * pdo.period_s:g} ms"
    first, byte = (owner, str(pdo.number), f"{pdo.can_id:03X}h", sent), 0
    for field in pdo.fields:
        place, name = f"{field.index:04X}h:{field.sub}", field.signal or "(not used)"
        yield *first, str(byte), place, TYPE_NAMES[field.code], name
        first, byte = ("", "", "", ""), byte + CODES[field.code]


def _bus(service: Service) -> TextTable:
    rows = list(_traffic_rows(service))
    total = sum(each.bits_per_second for each in traffic(service))
    shares = ", ".join(f"{100 * total / rate:.0f} % of {rate // 1000} kbit/s" for rate in BIT_RATES)
    notes = [f"in all {total:.0f} bit/s with the most stuff bits: {shares}"]
    if not service.sync_producer:
        notes.append("without SYNC, which another node produces")
    return TextTable("Bus load", ("frames", "COB-ID", "bytes", "per second", "bit/s at most"), rows, notes)


def _traffic_rows(service: Service) -> Iterator[tuple[str, ...]]:
    for each in traffic(service):
        rate = f"{each.per_second:.1f}"
        yield each.what, f"{each.can_id:03X}h", str(each.data_bytes), rate, f"{each.bits_per_second:.0f}"


def warnings(service: Service) -> list[str]:
    """Return sentences on cylinders that are slightly too short or too long for their joint's angle range.

    The checks of the machine file do not cover them: the error is small, or the cylinder reaches over several joints.
    """
    found = []
    for c in cylinder_numbers(service.machine):
        link = service.machine.links[c.joint].name
        for left, end, cure in zip(c.left, ("closed", "open"), ("shortest", "longest"), strict=True):
            if isnan(left):
                found.append(
                    f"{c.name}: its linkage cannot be closed all over the {link}'s angle_range_deg: correct one"
                )
                break
            little = -left < BEYOND_WARN * (c.opened - c.closed)
            if left < 0.0 and (little or c.reaches_over):
                found.append(
                    f"{c.name}: {-1e3 * left:.0f} mm of stroke are missing when {end}: correct its {cure} length in "
                    f"length_range_m, its pins, or the {link}'s angle_range_deg"
                )
    return found
