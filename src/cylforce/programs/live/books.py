"""Link between the service and its records: changes are written, and totals are shown in the object dictionary."""

from dataclasses import replace
from pathlib import Path

import cylforce
from cylforce.can.clock import now_us
from cylforce.canopen.dictionary.object_dictionary import (
    AUDIT_COUNT,
    COUNT,
    IN_PART,
    LAST,
    LOADING,
    MACHINE_ID,
    NO_RECORDS,
    PARAMETERS_ID,
    PART_NUMBER,
    PROTECTION,
    RECORDED,
    RECORDING,
    RECORDS,
    RECORDS_STOPPED,
    SOFTWARE_ID,
    TOOL,
    TOTAL,
    TRUCK,
)
from cylforce.canopen.node import Node
from cylforce.files.atomic import check_ordinary, warn
from cylforce.files.software import controller_id, short, software_sha256
from cylforce.mechanics.installation import STANDARD
from cylforce.records.audit import Audit
from cylforce.records.recorder import Recorder
from cylforce.records.writing import BY_HAND, BookedBucket, Change, Start
from cylforce.service.booking import Weighed
from cylforce.service.commands import KG, PRODUCT, TARGET, TRAILER
from cylforce.service.loading.cycle import LastBucket
from cylforce.service.loading.truck import Truck
from cylforce.service.memory import NOTHING_KEPT, Memory
from cylforce.service.service import WeighingService
from cylforce.settings.identified import identified_seal
from cylforce.settings.machine_file import Loaded
from cylforce.settings.seal import user
from cylforce.signals.estimate import Booking, is_new

OFTEN = 10  # steps between two checks of the writing thread
AUDIT_MOST, AUDIT_US = 20, 60_000_000  # audit entries that SDO clients cause, and in which time; chosen
SAME_LOAD = 0.02  # share by which the weight of a carried load may change without being written again; chosen


class Ledger:
    """Looks at every state of the service; without a recorder it only shows."""

    def __init__(
        self, node: Node, recorder: Recorder | None, kept: Memory, tools: tuple[str, ...] = (STANDARD,)
    ) -> None:
        self._tools = tools
        self._node, self._recorder, self._kept, self._steps = node, recorder, kept, 0
        self._written = kept.booking
        self._minute_us = self._audits = self._withheld = 0
        self._show(kept)

    @property
    def lifetime(self) -> float | None:
        """Mass of all loads ever [kg]; None without records."""
        return None if self._recorder is None else self._recorder.lifetime

    def audit(self, t_us: int, who: str, what: str) -> None:
        """Append an entry to the audit trail.

        Of more than AUDIT_MOST entries a minute only the number is kept, so that nobody can fill the disk with them.
        """
        if self._recorder is None:
            return
        if not 0 <= t_us - self._minute_us < AUDIT_US:
            self._minute_us, self._audits = t_us, 0
        self._audits += 1
        if self._audits > AUDIT_MOST:
            self._withheld += 1
            return
        more = f" (before it {self._withheld} entries were withheld: too many)" if self._withheld else ""
        self._withheld = 0
        self._recorder.put(Audit(t_us, who, f"{what}{more}"))

    def reloaded(self, t_us: int, seal: str) -> None:
        """Enter new parameters into the audit trail."""
        self.audit(t_us, "reload", f"parameters: {seal}")

    def look(self, service: WeighingService) -> None:
        """Write a change of the service's memory to the records, and show it."""
        kept, books = service.memory, service.bookings
        if is_new(kept.booking, self._kept.booking):
            self._change(service, kept, None)
        elif books.dumped is None and books.booking is not self._written:
            self._change(service, kept, books.booking)
        elif changed(self._kept, kept):
            self._change(service, kept, None)
        self._steps += 1
        if self._steps % OFTEN == 0:
            self._show_records()

    def _change(self, service: WeighingService, kept: Memory, final: Booking | None) -> None:
        """Write a change to the records, and show it.

        final: a booking whose bucket has returned
        """
        booked = _booked(service, self._kept)
        if self._recorder is not None:
            said = words(self._kept, kept)
            self._recorder.put(Change(service.estimate.t_us, kept, booked, said, final))
        self._kept = kept
        if booked is not None or final is not None:
            self._written = kept.booking
        self._show(kept)

    def _show(self, kept: Memory) -> None:
        truck = kept.truck
        shown = {TARGET: round(truck.target / KG), PRODUCT: truck.product, TRUCK: truck.number}
        shown |= {TOTAL: round(truck.total / KG), COUNT: truck.filled, TRAILER: round(truck.trailer / KG)}
        shown |= {IN_PART: round(truck.in_part / KG), PART_NUMBER: truck.part}
        shown[TOOL] = self._tools.index(kept.tool) if kept.tool in self._tools else 0
        shown[LAST] = kept.booking.number if kept.booking else 0
        for sub, value in shown.items():
            self._node.set_value(LOADING, sub, value)
        self._show_records()

    def _show_records(self) -> None:
        if self._recorder is None:
            self._node.set_value(LOADING, RECORDS, NO_RECORDS)
            return
        self._recorder.report_failure()
        self._node.set_value(PROTECTION, AUDIT_COUNT, self._recorder.audited)
        self._node.set_value(LOADING, RECORDED, self._recorder.recorded)
        self._node.set_value(LOADING, RECORDS, RECORDS_STOPPED if self._recorder.failure else RECORDING)


def changed(before: Memory, after: Memory) -> bool:
    """Return whether there is a change by the operator, another load, or a newly reported lost load.

    A mass that becomes more precise is written when it is final.
    """
    return (
        after.scale is not before.scale
        or after.tool != before.tool
        or _decided(after.truck) != _decided(before.truck)
        or _another(before.hanging, after.hanging)
        or before.lost != after.lost
    )


def _another(before: Weighed | None, after: Weighed | None) -> bool:
    """Return whether the tool carries another load, not the same one weighed more precisely."""
    if before is None or after is None:
        return before is not after
    return abs(after.mass - before.mass) > SAME_LOAD * before.mass


def _decided(truck: Truck) -> tuple[object, ...]:
    """Return the decisions of the operator about a truck."""
    aims = truck.target, truck.trailer, truck.part
    return truck.number, *aims, truck.product, tuple((b.number, b.accepted) for b in truck.buckets)


def _booked(service: WeighingService, before: Memory) -> BookedBucket | None:
    """Return a new booking with its cycle; None without one."""
    booking, cycle = service.bookings.booking, service.ended.figures
    if booking is None or not is_new(booking, before.booking):
        return None
    if booking.by_hand:
        return BookedBucket(booking, LastBucket(0.0, 0.0, 0.0), 0.0, BY_HAND)
    return BookedBucket(booking, cycle, service.drift.mass, service.estimate.load.mass.status.name)


def words(before: Memory, after: Memory) -> str:
    """Return the changes by an operator in words; empty after a booking alone."""
    said = []
    if after.scale != before.scale:
        said.append(f"zero {after.scale.zero:.1f} kg, tare {after.scale.tare:.1f} kg")
    if after.tool != before.tool:
        said.append(f"attachment {after.tool}")
    if after.truck.number != before.truck.number:
        said.append(f"truck {after.truck.number} opened")
    elif not is_new(after.booking, before.booking) and _decided(after.truck) != _decided(before.truck):
        said.append(_truck_words(after.truck))
    return "; ".join(said)


def _truck_words(truck: Truck) -> str:
    off = ", ".join(str(bucket.number) for bucket in truck.buckets if not bucket.accepted) or "none"
    part = f"part {truck.part}, " if truck.part > 1 else ""
    trailer = f", trailer {truck.trailer:.1f} kg" if truck.trailer else ""
    return f"{part}target {truck.target:.1f} kg{trailer}, product {truck.product}, cancelled: {off}"


def open_recorder(path: Path | None, loaded: Loaded, identified: Path | None = None) -> Recorder | None:
    """Return the records of this start of the service; None without a path.

    Software, machine file and parameters are entered into the audit trail if they differ from the last start. Raises
    RecordingError when another service writes the records, or where they are no ordinary file.
    """
    if path is None:
        return None
    check_ordinary(path)
    now = (
        ("software", f"{cylforce.__version__} {software_sha256()[:16]}"),
        ("machine file", f"{loaded.path.name} {loaded.sha256[:16]}"),
        ("parameters", sealed_as(identified)),
    )
    return Recorder(path, Start(now_us(), cylforce.__version__, loaded.service.machine.name, user(), now))


def kept_by(recorder: Recorder | None, identified: Path | None) -> Memory:
    """Return the memory of earlier starts, and mark identified parameters that are to be confirmed."""
    kept, elsewhere = recorder.kept if recorder else NOTHING_KEPT, from_elsewhere(identified)
    if elsewhere:
        warn(f"{identified}: is of another controller: nothing is OK until `cylforce seal` confirms it here")
    return replace(kept, unconfirmed=elsewhere)


def from_elsewhere(identified: Path | None) -> bool:
    """Return whether the parameters were sealed on another controller, so that they may be another machine's."""
    seal = None if identified is None else identified_seal(identified)
    return identified is not None and (seal.controller if seal else "") != controller_id()


def sealed_as(identified: Path | None) -> str:
    """Return the file's seal in words."""
    seal = None if identified is None else identified_seal(identified)
    if identified is None or seal is None:
        return "of the data sheet"
    return f"{identified.name} seal {seal.counter} {seal.sha256[:16]} by {seal.who} {seal.date}: {seal.reason}"


def show_identity(node: Node, loaded: Loaded, identified: Path | None) -> None:
    """Show the hashes of software, machine file and parameters in the object dictionary."""
    seal = None if identified is None else identified_seal(identified)
    for sub, sha256 in (
        (SOFTWARE_ID, software_sha256()),
        (MACHINE_ID, loaded.sha256),
        (PARAMETERS_ID, "" if seal is None else seal.sha256),
    ):
        node.set_value(PROTECTION, sub, short(sha256))
