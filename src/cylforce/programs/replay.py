"""`cylforce replay`: a recording through the core of the service; with a bus, played as if its sensors sent it."""

import csv
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from math import inf
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console

from cylforce.estimation.residual import EMPTY_BELOW, GOOD_ENOUGH
from cylforce.files.atomic import replacing, warn
from cylforce.files.candump import Sent
from cylforce.files.logfile import Header
from cylforce.files.logreader import log_header, mismatches, with_ticks
from cylforce.files.recording import Events, open_pieces, sensor_frames
from cylforce.programs.common.readings import beginning, header_of, make_core
from cylforce.records.export import iso
from cylforce.service.core import Core
from cylforce.service.publication import published
from cylforce.service.published_values import FORCE_QUALITY, PAYLOAD_QUALITY, QUALITY
from cylforce.service.service import WeighingService
from cylforce.settings.machine_file import Loaded
from cylforce.signals.estimate import Array, Booking, Estimate, Quantity, Reason, Status
from cylforce.signals.events import Event, Frame

OK, INVALID = Status.OK, Status.INVALID
QUALITIES = (PAYLOAD_QUALITY, FORCE_QUALITY, *QUALITY.values())


Take = Callable[[Estimate], None]


class Played(NamedTuple):
    """Result of a replay.

    bookings:  the bookings, each in its last state
    compared:  number of sent frames that were compared
    different: number of sent frames that differed
    service:   the service in its state at the end
    """

    bookings: list[Booking]
    compared: int
    different: int
    service: WeighingService


class Replayed(NamedTuple):
    """Result of a replay (see `Played`) with all estimates.

    estimates: one per tick; an hour of them takes 600 MB
    """

    estimates: list[Estimate]
    bookings: list[Booking]
    compared: int
    different: int
    service: WeighingService


def run_replay(
    loaded: Loaded, recording: Path, identified: Path | None = None, tell: Callable[[str], None] = warn
) -> Replayed:
    """Play a recording through the core. Raises RecordingError or SettingsError, one sentence each."""
    estimates: list[Estimate] = []
    return Replayed(estimates, *stream_replay(loaded, recording, identified, estimates.append, tell))


def stream_replay(
    loaded: Loaded, recording: Path, identified: Path | None, take: Take, tell: Callable[[str], None] = warn
) -> Played:
    """Play a recording through the core in constant memory: every estimate goes to `take` and is not kept."""
    core, now = make_core(loaded, identified, tell), header_of(loaded, identified, "")
    found = stream_through(core, loaded, recording, tell, take, now)
    if found.different:
        header = log_header(recording)
        for sentence in mismatches(recording, header, now) if header else ():
            tell(sentence)
    return found


def replay_through(
    core: Core, loaded: Loaded, recording: Path, tell: Callable[[str], None], now: Header | None = None
) -> Replayed:
    """Play a recording through a core.

    now: header of a log of this core; with it a log that continues an earlier one starts from the recorded state
    """
    estimates: list[Estimate] = []
    return Replayed(estimates, *stream_through(core, loaded, recording, tell, estimates.append, now))


def stream_through(
    core: Core,
    loaded: Loaded,
    recording: Path,
    tell: Callable[[str], None],
    take: Take,
    now: Header | None = None,
) -> Played:
    """Play a recording through a core in constant memory: every estimate goes to `take` and is not kept."""
    source = open_pieces(recording, loaded.service, loaded.columns, report=tell)
    if isinstance(source, Events):
        header = source.header
        if header is None or now is None:
            return replay(WeighingService.start(core), source.events, take)
        return replay(beginning(core, header, now, recording, tell), source.events, take)
    frames = sensor_frames(source, loaded.service)
    return replay(WeighingService.start(core), with_ticks(frames, core.period_us, tell), take)


def replay(service: WeighingService, events: Iterable[Event | Sent], take: Take) -> Played:
    """Pass events to a service; frames that the daemon sent are compared bit by bit with the last tick's."""
    bookings: list[Booking] = []
    last: Estimate | None = None
    compared = different = 0
    ours = {pdo.can_id: pdo.number for pdo in service.core.service.publication}
    encoders = service.core.encoders
    for event in events:
        if isinstance(event, Sent):
            if event.can_id in ours:
                compared += 1
                different += last is None or encoders.data(last, ours[event.can_id]) != event.data
        elif isinstance(event, Frame):
            service.on_frame(event)
        else:
            last = service.on_tick(event.t_us)
            take(last)
            booking = last.booking
            if booking is not None and not (bookings and booking is bookings[-1]):
                same = bool(bookings) and bookings[-1].number == booking.number
                bookings[len(bookings) - same :] = [booking]
    return Played(bookings, compared, different, service)


def write_estimates(path: Path, estimates: Iterable[Estimate]) -> None:
    """Write the table of `estimates_table` at once."""
    with estimates_table(path) as write:
        for estimate in estimates:
            write(estimate)


@contextmanager
def estimates_table(path: Path) -> Iterator[Take]:
    """Yield a function that writes estimates as they come; the file replaces `path` when all are written.

    CSV has the time (`t_us`, `t_s` from the start, `time` as ISO text) and one column per published value, SI. It is
    empty without a value; status and reason are words.
    """
    with replacing(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer, begun = csv.writer(file), list[int]()

        def write(estimate: Estimate) -> None:
            first = not begun
            begun.extend([estimate.t_us] if first else [])
            row = _row(estimate, begun[0])
            if first:
                writer.writerow(row)
            writer.writerow(row.values())

        yield write


def _row(estimate: Estimate, begun: int) -> dict[str, str]:
    t_us = estimate.t_us
    row = {"t_us": str(t_us), "t_s": f"{1e-6 * (t_us - begun):.6f}", "time": iso(t_us)}
    for name, value in published(estimate).items():
        if name in QUALITIES:
            what, code = name.removesuffix("_quality"), int(value)
            row |= {f"{what}_status": Status(code & 3).name, f"{what}_reason": Reason(code >> 2).name}
        else:
            row[name] = "" if np.isnan(value) else repr(value)
    return row


def column(estimates: list[Estimate], name: str) -> Array:
    """Return one published value along a replay."""
    return np.array([published(estimate)[name] for estimate in estimates])


class Totals:
    """Counts for `show` about a replay of any length, updated with each estimate."""

    def __init__(self, rated_kg: float) -> None:
        """Begin with zero counts.

        rated_kg: the rated payload
        """
        self._rated = rated_kg
        self.begun_us: int | None = None
        self.steps = self.weights_ok = self.forces_ok = 0
        self._reasons: Counter[Reason] = Counter()
        self._known = self._load = inf  # the least standard error [kg] of a weight, and of one that is a load

    def take(self, estimate: Estimate) -> None:
        """Count one more estimate."""
        if self.begun_us is None:
            self.begun_us = estimate.t_us
        self.steps += 1
        self.weights_ok += estimate.gross.status is OK
        self.forces_ok += estimate.force.magnitude.status is OK
        self.weigh(estimate.gross)

    def weigh(self, weight: Quantity) -> None:
        """Count one more weight [kg]."""
        error = weight.standard_error
        if weight.status is INVALID:
            self._reasons[weight.reason] += 1
            return
        self._known = min(self._known, error)
        if error < self._load and weight.value >= max(EMPTY_BELOW * self._rated, 3.0 * error):
            self._load = error

    def unbooked(self) -> str:
        """Return a sentence why none of the weights became a booking, with the cure."""
        enough, best = GOOD_ENOUGH * self._rated, self._known if self._load == inf else self._load
        if best == inf and self._reasons:
            reason, _ = self._reasons.most_common(1)[0]
            return (
                f"there was no weight at any time, mostly {reason.name}: see the table of reasons in service/README.md"
            )
        if best > enough:
            cure = "move all joints, lift a known weight (identify --lift)"
            return f"UNCERTAIN, +- {best:.0f} kg of at most {enough:.0f} kg: {cure}"
        if self._load == inf:
            return f"no load above {EMPTY_BELOW * self._rated:.0f} kg was lifted"
        return "a load was weighed, but afterwards the empty tool was not seen in the air: lift it clear of the ground"


def show(found: Played, tally: Totals, console: Console) -> None:
    """Print the bookings or why there are none, the share of valid estimates, and the comparison with the frames sent
    live.
    """
    for booking in found.bookings:
        at = (booking.t_us - (tally.begun_us or 0)) * 1e-6
        console.print(f"{at:8.1f} s  booked {booking.mass:.1f} kg +- {booking.standard_error:.1f} kg")
    if tally.steps and not found.bookings:
        console.print(f"no weight was booked: {tally.unbooked()}")
    if tally.steps:
        good, force = (100.0 * count / tally.steps for count in (tally.weights_ok, tally.forces_ok))
        console.print(f"{tally.steps} steps; weight OK in {good:.1f} %, force in {force:.1f} %")
    if found.compared:
        console.print(f"{found.compared} frames were sent live, {found.different} differ now")
