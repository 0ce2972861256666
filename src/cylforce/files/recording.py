"""Open any recording: frames as events, tables as samples; both can be played as frames."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cylforce.files import logreader, tables
from cylforce.files.atomic import RecordingError, Report, check_ordinary, warn
from cylforce.files.candump import Sent
from cylforce.files.held import check_held
from cylforce.files.logfile import Header
from cylforce.files.tables import SlowTableError, Table, TableMap, joined, resampled, table_pieces
from cylforce.mechanics.installation import LATE_PERIODS, Service
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.unwrapping import Unwrapping
from cylforce.signals.codec import encode
from cylforce.signals.events import Event, Frame
from cylforce.signals.identifiers import EMCY, HEARTBEAT, SDO_REQUEST, SDO_RESPONSE, SYNC
from cylforce.signals.kinds import ANGLES
from cylforce.signals.layout import Pdo
from cylforce.signals.turns import Follower


class Events(NamedTuple):
    """A recording of a bus.

    header: header of our own log; None: another program's recording
    events: its events, and the frames that our node sent
    """

    header: Header | None
    events: Iterator[Event | Sent]


def open_recording(
    path: Path,
    service: Service,
    mapping: TableMap | None = None,
    *,
    channel: str | None = None,
    report: Report = warn,
) -> Events | Table:
    """Open a recording; return its events (.log, .blf, .asc) or its samples at the service's rate (.csv, .parquet).

    Raises RecordingError, at once or while events are read.

    mapping: columns and units of another program's table
    channel: chooses the bus of a log that holds several
    report: called with a sentence about omitted frames
    """
    recording = open_pieces(path, service, mapping, channel=channel, report=report)
    return recording if isinstance(recording, Events) else joined(list(recording))


def open_pieces(
    path: Path,
    service: Service,
    mapping: TableMap | None = None,
    *,
    channel: str | None = None,
    report: Report = warn,
) -> Events | Iterator[Table]:
    """Open a recording as `open_recording`; the samples of a table come piece by piece, as they are read."""
    rate_hz = service.filters.rate_hz
    if not path.exists():
        raise RecordingError(f"{path}: does not exist")
    check_ordinary(path)
    if path.suffix.lower() in tables.SUFFIXES:
        names = [signal.name for signal in service.machine.signals]
        late_s = [LATE_PERIODS * signal.period_s for signal in service.machine.signals]
        pieces = check_held(path, table_pieces(path, names, mapping, as_recording=True), late_s)
        return _unwrapped(path, pieces, service.machine, rate_hz)
    if path.suffix.lower() == ".toml":
        raise RecordingError(f"{path}: is no recording: a machine file is named once, before the recordings")
    if path.suffix.lower() not in logreader.SUFFIXES:
        known = ", ".join((*logreader.SUFFIXES, *tables.SUFFIXES))
        raise RecordingError(f"{path}: is none of the recordings that can be read ({known})")
    period_us = round(1e6 / rate_hz)
    header, events = logreader.read_events(path, period_us, channel=channel, own_ids=own_ids(service), report=report)
    return Events(header=header, events=events)


def rows_a_second(path: Path, service: Service, mapping: TableMap | None = None) -> float:
    """Return the rows a second of a table, by the median time step of its first piece.

    For a log of a bus, a path that does not exist, or a piece of one row it is the service's rate. Raises
    RecordingError.
    """
    if path.suffix.lower() not in tables.SUFFIXES or not path.exists():
        return service.filters.rate_hz
    check_ordinary(path)
    names = [signal.name for signal in service.machine.signals]
    steps = np.diff(next(table_pieces(path, names, mapping, as_recording=True)).t_s)
    return 1.0 / float(np.median(steps)) if len(steps) else service.filters.rate_hz


def _unwrapped(path: Path, pieces: Iterator[Table], machine: Machine, rate_hz: float) -> Iterator[Table]:
    """Yield the samples of a table at a fixed rate, with whole turns added to its angles.

    Angles are made continuous before values between two rows are interpolated: such a value would otherwise lie on the
    other side of the circle. Then the turns that the joints require are added.

    rate_hz: samples a second
    """
    unwrapping = Unwrapping(machine)
    for table in _at_rate(path, _continuous(pieces, machine), rate_hz):
        yield table._replace(values=unwrapping.of(table.values))


def _continuous(pieces: Iterator[Table], machine: Machine) -> Iterator[Table]:
    """Yield the pieces of a table with angles that do not leap where a sensor passes the end of its circle."""
    follower = Follower([k for k, signal in enumerate(machine.signals) if signal.kind in ANGLES])
    for piece in pieces:
        yield piece._replace(values=follower.follow(piece.values))


def _at_rate(path: Path, pieces: Iterator[Table], rate_hz: float) -> Iterator[Table]:
    """Yield the samples of a table at a fixed rate [Hz]. Raises RecordingError for too few rows a second."""
    try:
        yield from resampled(pieces, rate_hz)
    except SlowTableError as error:
        raise RecordingError(f"{path}: {error}") from error


def own_ids(service: Service) -> frozenset[int]:
    """Return the identifiers that only our own node sends: in another program's recording they identify its frames."""
    node = service.node_id
    fixed = {EMCY + node, SDO_RESPONSE + node, HEARTBEAT + node} | ({SYNC} if service.sync_producer else set())
    requests = {SDO_REQUEST + sensor.node_id for sensor in service.nodes}
    return frozenset(fixed | requests | {pdo.can_id for pdo in service.publication})


def sensor_frames(recording: Events | Table | Iterable[Table], service: Service) -> Iterator[Frame]:
    """Yield the frames (PDOs, heartbeats, emergencies) that the sensors would send if the recording took place again.

    The frames of a table, whole or in pieces, come at the service's rate.
    """
    pdos = [pdo for node in service.nodes for pdo in node.pdos]
    if isinstance(recording, Table):
        return as_frames(recording, pdos)
    if not isinstance(recording, Events):
        return _pieces_as_frames(recording, pdos, round(1e6 / service.filters.rate_hz))
    nodes = [node.node_id for node in service.nodes]
    wanted = {pdo.can_id for pdo in pdos} | {base + n for base in (EMCY, HEARTBEAT) for n in nodes}
    return (event for event in recording.events if isinstance(event, Frame) and event.can_id in wanted)


def as_frames(table: Table, pdos: Sequence[Pdo]) -> Iterator[Frame]:
    """Yield a table's samples in the sensors' PDOs: each at its period, but at most once a row.

    Synchronous PDOs come every `sync` rows: each row counts as a SYNC. The table has two rows or more, evenly spaced.
    NaN, and signals that the table does not have, become the PDO's "no value". A frame's time is its row's.
    """
    return _pieces_as_frames([table], pdos, round((table.t_s[1] - table.t_s[0]) * 1e6))


def _pieces_as_frames(pieces: Iterable[Table], pdos: Sequence[Pdo], step: int) -> Iterator[Frame]:
    """Yield the frames of a table in pieces; `step`: time between two rows [us]."""
    due: list[int] = []
    unknown = dict.fromkeys((f.signal for p in pdos for f in p.fields if f.signal), float("nan"))
    for piece in pieces:
        for t_s, row in zip(piece.t_s.tolist(), piece.values.tolist(), strict=True):
            t_us = round(t_s * 1e6)
            due = due or [t_us] * len(pdos)
            values = unknown | dict(zip(piece.signals, row, strict=True))
            for k, pdo in enumerate(pdos):
                if t_us >= due[k] - step // 2:
                    period = step * max(pdo.sync, 1) if pdo.synchronous else round(pdo.period_s * 1e6)
                    due[k] = max(due[k] + period, t_us)
                    yield Frame(t_us, pdo.can_id, encode(pdo, values))
