"""`cylforce replay`: a recording through the core of the service; with a bus, played as if its sensors sent it."""

import csv
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console

from cylforce.estimation.residual import GOOD_ENOUGH, SMALLEST
from cylforce.files.atomic import replacing, warn
from cylforce.files.candump import Sent
from cylforce.files.logfile import Header
from cylforce.files.logreader import log_header, mismatches, with_ticks
from cylforce.files.recording import Events, open_recording, sensor_frames
from cylforce.programs.common.readings import beginning, header_of, make_core
from cylforce.records.export import iso
from cylforce.service.publication import FORCE_QUALITY, PAYLOAD_QUALITY, QUALITY, published
from cylforce.service.state import State
from cylforce.service.step import Core, step
from cylforce.settings.machine_file import Loaded
from cylforce.signals.estimate import Array, Booking, Estimate, Quantity, Reason, Status
from cylforce.signals.events import Event

QUALITIES = (PAYLOAD_QUALITY, FORCE_QUALITY, *QUALITY.values())


class Replayed(NamedTuple):
    """What a replay gave: `estimates` one per tick, bookings, sent frames that were compared and that differed."""

    estimates: list[Estimate]
    bookings: list[Booking]
    compared: int
    different: int
    state: State


def run_replay(
    loaded: Loaded, recording: Path, identified: Path | None = None, tell: Callable[[str], None] = warn
) -> Replayed:
    """Play a recording through the core. Raises RecordingError or SettingsError, one sentence each."""
    core, now = make_core(loaded, identified, tell), header_of(loaded, identified, "")
    found = replay_through(core, loaded, recording, tell, now)
    if found.different:
        header = log_header(recording)
        for sentence in mismatches(recording, header, now) if header else ():
            tell(sentence)
    return found


def replay_through(
    core: Core, loaded: Loaded, recording: Path, tell: Callable[[str], None], now: Header | None = None
) -> Replayed:
    """Play a recording through a core. `now` is the header that a log of it would begin with: where given, a log that
    continues an earlier one goes on from the state of that moment."""
    source = open_recording(recording, loaded.service, loaded.columns, tell=tell)
    if isinstance(source, Events):
        header = source.header
        state = core.begin() if header is None or now is None else beginning(core, header, now, recording, tell)
        return replay(core, source.events, state)
    frames = sensor_frames(source, loaded.service)
    return replay(core, with_ticks(frames, core.period_us, tell), core.begin())


def replay(core: Core, events: Iterable[Event | Sent], state: State) -> Replayed:
    """The scan of `step` over events from `state` on; frames that the daemon sent are compared bit by bit."""
    estimates: list[Estimate] = []
    bookings: list[Booking] = []
    expected: dict[int, bytes] = {}
    compared = different = 0
    identifiers = {pdo.number: pdo.can_id for pdo in core.service.publication}
    for event in events:
        if isinstance(event, Sent):
            if event.can_id in identifiers.values():
                compared += 1
                different += expected.get(event.can_id) != event.data
            continue
        state, out = step(core, state, event)
        if out.estimate is not None:
            expected = {identifiers[number]: data for number, data in out.frames}
            estimates.append(out.estimate)
            booking = out.estimate.booking
            if booking is not None:
                same = bool(bookings) and bookings[-1].number == booking.number
                bookings[len(bookings) - same :] = [booking]
    return Replayed(estimates, bookings, compared, different, state)


def write_estimates(path: Path, estimates: Iterable[Estimate]) -> None:
    """CSV: the time (`t_us`, `t_s` from the start, `time` as ISO text) and one column per published value, SI; empty
    where there is no value; status and reason as words."""
    with replacing(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer, begun = csv.writer(file), None
        for estimate in estimates:
            begun = estimate.t_us if begun is None else begun
            row = _row(estimate, begun)
            if estimate.t_us == begun:
                writer.writerow(row)
            writer.writerow(row.values())


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
    """One published value along a replay."""
    return np.array([published(estimate)[name] for estimate in estimates])


def unbooked(weights: Sequence[Quantity], rated_kg: float) -> str:
    """Why none of these weights [kg] became a booking, with the cure; `rated_kg`: the rated payload."""
    enough, known = GOOD_ENOUGH * rated_kg, [w for w in weights if w.status is not Status.INVALID]
    if not known:
        reason, _ = Counter(w.reason for w in weights).most_common(1)[0]
        return f"there was no weight at any time, mostly {reason.name}: see the table of reasons in service/README.md"
    loads = [w for w in known if w.value >= max(SMALLEST * rated_kg, 3.0 * w.standard_error)]
    best = min(w.standard_error for w in loads or known)
    if best > enough:
        cure = "move all joints, lift a known weight (identify --lift)"
        return f"UNCERTAIN, +- {best:.0f} kg of at most {enough:.0f} kg: {cure}"
    if not loads:
        return f"no load above {SMALLEST * rated_kg:.0f} kg was lifted"
    return "a load was weighed, but afterwards the empty tool was not seen in the air: lift it clear of the ground"


def show(found: Replayed, rated_kg: float, console: Console) -> None:
    """What was booked or why nothing was, how much was measured, whether the frames sent live came out again."""
    for booking in found.bookings:
        at = (booking.t_us - found.estimates[0].t_us) * 1e-6
        console.print(f"{at:8.1f} s  booked {booking.mass:.1f} kg +- {booking.standard_error:.1f} kg")
    if found.estimates and not found.bookings:
        console.print(f"no weight was booked: {unbooked([e.gross for e in found.estimates], rated_kg)}")
    if found.estimates:
        good = np.mean([e.gross.status is Status.OK for e in found.estimates])
        force = np.mean([e.force.magnitude.status is Status.OK for e in found.estimates])
        console.print(f"{len(found.estimates)} steps; weight OK in {100 * good:.1f} %, force in {100 * force:.1f} %")
    if found.compared:
        console.print(f"{found.compared} frames were sent live, {found.different} differ now")
