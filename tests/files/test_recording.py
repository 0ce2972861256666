"""A recording is opened as events, or samples at the service's rate; either can be sent as by sensors."""

from itertools import pairwise

import numpy as np
import pytest

from cylforce.files.atomic import RecordingError
from cylforce.files.candump import Sent
from cylforce.files.logfile import Header, LogWriter
from cylforce.files.recording import Events, as_frames, open_recording, own_ids, sensor_frames
from cylforce.files.tables import ColumnMap, Table, TableMap
from cylforce.mechanics.installation import Filters, Health, SensorNode, Service
from cylforce.mechanics.machine import Machine
from cylforce.service.publication import publication
from cylforce.signals.codec import decode
from cylforce.signals.events import EXTENDED, Frame, Tick
from cylforce.signals.kinds import Kind, Signal
from cylforce.signals.layout import Field, Pdo

NODE, T0 = 10, 1_700_000_000_000_000
HEAD = Field("head", 0x7130, 1, "h", 1e4, 0.0, "Pa", -1e5, 4e7)
ROD = Field("rod", 0x7130, 2, "H", 1e4, 0.0, "Pa", 0.0, 4e7)
ANGLE = Field("angle", 0x6004, 0, "f", 1.0, 0.0, "rad", -3.2, 3.2)
GAP = Field(None, 0x2000, 1, "B", 1.0, 0.0, "1", 0.0, 255.0)
PRESSURES = Pdo(0x185, 5, 1, True, 1, 0.0, (HEAD, GAP, ROD))
ANGLES = Pdo(0x286, 6, 2, False, 0, 0.02, (ANGLE,))


def node(name, node_id, pdo):
    return SensorNode(name, node_id, 404, (None,) * 4, 0.5, (pdo,), True)


def signal(name, kind):
    return Signal(name, kind, 0, -1e9, 1e9, 0.01, 1.0)


@pytest.fixture
def service():
    signals = (
        signal("head", Kind.HEAD_PRESSURE),
        signal("rod", Kind.ROD_PRESSURE),
        signal("angle", Kind.JOINT_ANGLE),
    )
    return Service(
        machine=Machine("arm", (), (), signals, 0j, 1500.0, 5.0, 0.0),
        nodes=(node("pressures", 5, PRESSURES), node("angles", 6, ANGLES)),
        publication=publication(NODE, 0.01, 1500.0, 1e5),
        node_id=NODE,
        sync_producer=True,
        heartbeat_s=0.5,
        filters=Filters(100.0, 20.0, 1.0, 2.0, 0.01),
        health=Health(0.2, 10, 100, 0.3, 0.5),
        effects=(),
    )


def samples(rows=50):
    t = np.arange(rows) / 100
    values = np.column_stack([2e7 + 1e6 * np.sin(t), 1e6 + 1e5 * t, np.cos(t)])
    return Table(t, values, ("head", "rod", "angle"))


def as_csv(path, table, names):
    rows = np.column_stack([table.t_s, table.values])
    path.write_text(",".join(names) + "\n" + "\n".join(",".join(map(repr, r.tolist())) for r in rows) + "\n")
    return path


def test_a_table_is_samples_at_the_service_s_rate(tmp_path, service):
    half = Table(samples(100).t_s[::2], samples(100).values[::2], samples().signals)
    found = open_recording(as_csv(tmp_path / "run.csv", half, ("t_s", "head", "rod", "angle")), service)
    assert isinstance(found, Table)
    assert found.signals == ("head", "rod", "angle")
    np.testing.assert_allclose(found.t_s, np.arange(99) / 100, atol=1e-12)
    np.testing.assert_allclose(found.values, samples(99).values, rtol=1e-4)


def test_a_mapping_is_obeyed(tmp_path, service):
    path = as_csv(tmp_path / "run.csv", samples(), ("ms", "p1", "rod", "angle"))
    mapping = TableMap("ms", 2.0, (ColumnMap("head", "p1", 1e-5, 1.0),))
    found = open_recording(path, service, mapping)
    np.testing.assert_allclose(found.values[::2, 0], samples().values[:, 0] * 1e-5 + 1.0)
    with pytest.raises(RecordingError, match=r"run\.csv: has no column t_s, head; it has ms, p1, rod, angle"):
        open_recording(path, service)


def test_a_table_too_slow_is_refused_by_name(tmp_path, service):
    slow = samples()._replace(t_s=np.arange(50) * 1.0)
    with pytest.raises(RecordingError, match=r"run\.csv: the table has 1 rows a second, too few for 100 Hz"):
        open_recording(as_csv(tmp_path / "run.csv", slow, ("t_s", "head", "rod", "angle")), service)


def test_what_cannot_be_opened(tmp_path, service):
    with pytest.raises(RecordingError, match=r"x\.csv: does not exist"):
        open_recording(tmp_path / "x.csv", service)
    (tmp_path / "x.mf4").touch()
    with pytest.raises(RecordingError, match=r"can be read \(\.log, \.blf, \.asc, \.csv, \.parquet\)"):
        open_recording(tmp_path / "x.mf4", service)


def test_our_own_log_is_its_events(tmp_path, service):
    events = [
        Frame(T0, 0x185, b"\1"),
        Tick(T0 + 1),
        Sent(T0 + 2, 0x18A, b"\2"),
        Frame(T0 + 3, 0x18A, b"\3"),
        Frame(T0 + 4, 0x706, b"\5"),
    ]
    header = Header(
        versions={}, machine="m", machine_sha256="", identified_sha256=None, state={}, bus="b", node_id=NODE
    )
    with LogWriter(tmp_path / "run.log", header, T0, "can0") as log:
        for event in events:
            log.log(event)
    found = open_recording(tmp_path / "run.log", service)
    assert isinstance(found, Events)
    assert found.header == header
    assert list(found.events) == events  # 18Ah was received: somebody else sent it, and that must replay
    again = open_recording(tmp_path / "run.log", service)
    assert list(sensor_frames(again, service)) == [events[0], events[4]]


def test_in_a_foreign_log_our_frames_are_told_apart_by_identifier(tmp_path, service):
    own = [0x080, 0x08A, 0x18A, 0x28A, 0x38A, 0x48A, 0x20A, 0x30A, 0x40A, 0x50A, 0x58A, 0x605, 0x606, 0x70A]
    others = [0x000, 0x085, 0x185, 0x286, 0x60A, 0x585, 0x705, 0x18B, 0x18A | EXTENDED]
    names = [f"{i & 0x1FFFFFFF:08X}" if i & EXTENDED else f"{i:03X}" for i in own + others]
    path = tmp_path / "foreign.log"
    path.write_text("".join(f"(1.000000) can0 {name}#00\n" for name in names))
    events = list(open_recording(path, service).events)
    assert [e.can_id for e in events if isinstance(e, Sent)] == own
    assert [e.can_id for e in events if isinstance(e, Frame)] == others
    assert own_ids(service) == frozenset(own)
    found = [f.can_id for f in sensor_frames(open_recording(path, service), service)]
    assert found == [0x085, 0x185, 0x286, 0x705]


def test_a_table_as_its_sensors_would_send_it(service):
    table = samples()
    frames = list(as_frames(table, [PRESSURES, ANGLES]))
    pressures = [f for f in frames if f.can_id == 0x185]
    angles = [f for f in frames if f.can_id == 0x286]
    assert [f.t_us for f in pressures] == [k * 10_000 for k in range(50)]
    assert [f.t_us for f in angles] == [k * 20_000 for k in range(25)]  # its own, slower period
    found = np.array([[decode(PRESSURES, f.data)[name] for name in ("head", "rod")] for f in pressures])
    np.testing.assert_allclose(found, table.values[:, :2], atol=0.5e4)
    np.testing.assert_allclose([decode(ANGLES, f.data)["angle"] for f in angles], table.values[::2, 2], rtol=1e-6)
    assert list(sensor_frames(table, service)) == frames


def test_a_table_in_pieces_is_sent_as_if_it_were_whole(service):
    """One row, none, many: the same frames, also where the table does not begin at zero."""
    table = samples()
    table = table._replace(t_s=table.t_s + 3.21)
    cuts = [0, 1, 1, 20, len(table.t_s)]
    pieces = [Table(table.t_s[a:b], table.values[a:b], table.signals) for a, b in pairwise(cuts)]
    assert list(sensor_frames(iter(pieces), service)) == list(sensor_frames(table, service))


def test_every_second_sync_is_every_second_row():
    frames = list(as_frames(samples(7), [PRESSURES._replace(sync=2)]))
    assert [f.t_us for f in frames] == [0, 20_000, 40_000, 60_000]


def test_what_is_unknown_is_sent_as_no_value():
    table = samples()
    table.values[3, 0] = np.nan
    without_rod = Table(table.t_s, table.values[:, :1], ("head",))
    frames = list(as_frames(without_rod, [PRESSURES]))
    heads = np.array([decode(PRESSURES, f.data)["head"] for f in frames])
    assert np.flatnonzero(np.isnan(heads)).tolist() == [3]
    assert all(np.isnan(decode(PRESSURES, f.data)["rod"]) for f in frames)
