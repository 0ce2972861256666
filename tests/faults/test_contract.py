"""The fault contract is what its page says, and its tests exist; the faults of sensors, one by one, on the project's
own simulated excavator."""

import ast
import sys
from pathlib import Path

import numpy as np
import pytest

from cylforce.canopen.emergency import Emergencies
from cylforce.files.logreader import with_ticks
from cylforce.files.recording import as_frames
from cylforce.files.tables import Table
from cylforce.mechanics.machine import Machine
from cylforce.programs.common.play import prepare
from cylforce.programs.live.sensor_messages import SensorMessages
from cylforce.service.core import Core
from cylforce.service.plausibility.suspicion import NOTHING_SUSPECTED, Level, SensorFault
from cylforce.settings.machine_file import load
from cylforce.signals.estimate import Booking, Reason, Status
from cylforce.signals.units import DEGREE
from faulting.edits import BAR, Fault, edited
from faulting.runs import errors, followed
from scenarios import EXCAVATOR, SEED, identified

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))
import contract  # noqa: E402  # the program beside this file

BEGIN = 12.0  # s: in the first cycle, after some motion in order
HEAD, ROD, STICK_ANGLE, BUCKET_ANGLE = 0, 1, 7, 8


def test_the_page_is_written_from_the_contract():
    assert contract.README.read_text(encoding="utf-8") == contract.page(), "python tests/faults/contract.py"


def test_every_fault_stands_once_and_in_order():
    numbers = [row.number for row in contract.rows()]
    assert numbers == sorted(set(numbers))
    assert set(numbers) <= set(range(1, contract.FAULTS + 1))


SHOWN = {f"fault {row.number}": row.shown for row in contract.rows()} | {a.done: a.shown for a in contract.attacks()}


@pytest.mark.parametrize("fault", SHOWN)
def test_the_tests_that_show_a_fault_exist(fault):
    assert SHOWN[fault]
    for test in SHOWN[fault]:
        file, _, name = test.partition("::")
        tree = ast.parse((HERE.parent / file).read_text(encoding="utf-8"))
        assert name in {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}, test


class Told:
    """A journal that keeps what was said."""

    def __init__(self):
        self.lines = []

    def info(self, event, **_):
        self.lines.append(event)

    def warning(self, event, **words):
        self.lines.append((event, words))


class Work:
    """Three cycles of the simulated excavator: its service and samples."""

    def __init__(self):
        loaded = load(EXCAVATOR)
        self.service, self.core = loaded.service, Core(loaded.service, identified(loaded))
        records = prepare(loaded, "cycles", SEED, 0.1, amount=3).records
        self.values = np.concatenate([record.values for record in records])

    @property
    def machine(self) -> Machine:
        return self.service.machine

    def with_fault(self, fault):
        """What the service says."""
        values = edited(self.values, self.service.filters.rate_hz, fault, self.machine).values
        times = np.arange(len(values)) / self.service.filters.rate_hz
        table = Table(times, values, tuple(s.name for s in self.machine.signals))
        pdos = [pdo for node in self.service.nodes for pdo in node.pdos]
        return followed(self.core, with_ticks(as_frames(table, pdos), self.core.period_us, print))


@pytest.fixture(scope="module")
def work():
    """Made once."""
    return Work()


FAULTS_OF_SENSORS = [
    (Fault("nodes exchanged", 0, 1, begin=BEGIN), SensorFault.CONTRADICTS_MOTION, 0xFF10, 12.0),
    (Fault("sides exchanged", 0, begin=BEGIN), SensorFault.CONTRADICTS_MOTION, 0xFF10, 12.0),
    (Fault("dead", ROD, begin=BEGIN), SensorFault.FROZEN, 0xFF20, 25.0),
    (Fault("frozen", ROD, begin=BEGIN), SensorFault.FROZEN, 0xFF20, 25.0),
    (Fault("burst", HEAD, begin=BEGIN), SensorFault.BURST, 0xFF22, 0.11),
    (Fault("step", HEAD, size=15.0 * BAR, begin=BEGIN), SensorFault.OFFSET, 0xFF23, 25.0),
    (Fault("step", ROD, size=-6.5 * BAR, begin=BEGIN), SensorFault.BELOW_VACUUM, 0xFF23, 25.0),
    (Fault("slipped", STICK_ANGLE, size=6.0 * DEGREE, begin=BEGIN), SensorFault.ANGLE_STEPPED, 0xFF24, 2.0),
    (Fault("sliding", STICK_ANGLE, size=6.0 * DEGREE, begin=BEGIN), SensorFault.SLIPPED, 0xFF24, 30.0),
]


@pytest.mark.parametrize(("fault", "cause", "code", "within"), FAULTS_OF_SENSORS, ids=lambda x: getattr(x, "kind", ""))
def test_a_fault_of_a_sensor(work, fault, cause, code, within):
    course = work.with_fault(fault)
    first = next((t, s) for t, s in course.suspicions if s.cause is cause and s.level is Level.REJECTED)
    assert BEGIN <= first[0] <= BEGIN + within
    after = course.t_s > first[0] + 0.02
    if first[1].latched:
        assert not course.ok[after].any()
        assert course.service.monitor.suspicion.level is Level.REJECTED
        assert course.service.estimate.gross.status is Status.INVALID
        assert course.service.estimate.force.x.reason in (Reason.SENSORS_DISAGREE, Reason.FROZEN)
    sent, told = [], Told()
    messages = SensorMessages(work.machine, Emergencies(lambda data: not sent.append(data), lambda *_: None), told)
    messages.report(first[1])
    assert int.from_bytes(sent[0][:2], "little") == code
    assert told.lines[0][1]["signals"] == [work.machine.signals[k].name for k in first[1].signals]
    messages.report(NOTHING_SUSPECTED)
    assert sent[1][:2] == bytes(2)


@pytest.mark.parametrize("degrees", [-6.5, 6.5])
def test_the_empty_bucket_tells_that_its_angle_has_slipped(work, degrees):
    """A load turned in the bucket explains a bucket angle that is off; an empty bucket has no load to turn. In the
    second cycle, so that oil is no longer as good an explanation."""
    fault = Fault("sliding", BUCKET_ANGLE, size=degrees * DEGREE, begin=22.0)
    course, order = work.with_fault(fault), work.with_fault(fault._replace(size=0.0))
    assert not order.suspicions
    t, suspicion = next((t, s) for t, s in course.suspicions if s.cause is SensorFault.IMPOSSIBLE_MOMENTS)
    assert 22.0 < t < 37.0
    assert (suspicion.level, len(suspicion.signals)) == (Level.SUSPECTED, len(work.machine.signals))
    after = course.t_s > t + 0.02
    assert not course.ok[after].any()
    assert not [b for b in course.bookings if 1e-6 * b.t_us > t]


def test_bookings_are_compared_with_those_of_the_same_bucket():
    """One in time, one that waited, one of a bucket that was booked already, none before."""
    order = [booking(20, 900.0), booking(40, 700.0)]
    assert errors([booking(19, 905.0), booking(46, 690.0), booking(50, 300.0)], order) == [5.0, -10.0, 300.0]
    assert errors([booking(10, 400.0), booking(21, 905.0)], order) == [400.0, 5.0]


def booking(seconds, mass):
    return Booking(1, seconds * 1_000_000, mass, 5.0, 0.0, 5.0, mass, 5.0)
