"""A second producer of a sensor's identifier, a heartbeat that stops while the PDOs go on, and our own identifiers sent
by somebody else."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from cylforce.estimation.kernel.inputs import NEVER
from cylforce.service.assembler import assembler
from cylforce.service.core import Core
from cylforce.service.senders.channels import QUIET_US
from cylforce.service.senders.supervision import FAST_CLOCK, Supervisor
from cylforce.service.service import MOST_FRAMES, WeighingService
from cylforce.settings.machine_file import load
from cylforce.signals.codec import decode, encode
from cylforce.signals.estimate import Reason, Status
from cylforce.signals.events import Frame, Tick
from scenarios import EXCAVATOR, START_US, cycles, fed, identified, pdo_of, seconds, with_raw

SERVICE = load(EXCAVATOR).service
PERIOD_US = 10_000
SHORTEST_US = PERIOD_US * (1.0 - FAST_CLOCK)


def paced(times):
    """What is known of a PDO after frames at `times` [us], and when each alarm came."""
    inputs, pdo = assembler(SERVICE), pdo_of(SERVICE, "stick_angle")
    place = [each for _, each in inputs.constants.supervisor.pdos].index(pdo)
    data, alarms = encode(pdo, {"stick_angle": -1.0}), []
    doubled = inputs.constants.layout.second_us
    for t in map(int, times):
        inputs.receive([Frame(t, pdo.can_id, data)])
        if inputs.state[doubled][place] == t:  # `inputs.pdos` would make all of them anew at each frame
            alarms.append(t)
    return (lambda t_us: pdo in inputs.doubled(t_us)), alarms


def late(count, rng, most):
    """A producer whose frames wait up to `most` periods for the bus."""
    return np.sort((np.arange(count) + most * rng.random(count)) * PERIOD_US)


@pytest.mark.parametrize("most", [0.0, 0.3, 0.99])
def test_one_producer_raises_no_alarm_however_its_frames_wait(most):
    rng = np.random.default_rng(1)
    assert paced(late(100_000, rng, most))[1] == []


def test_a_sensor_that_gets_the_processor_in_slices_raises_none():
    """It answers each SYNC, ever later until it has caught up: 0, 4, 8 to 36 ms late, then all at once."""
    times = np.maximum.accumulate([PERIOD_US * k + 4_000 * (k % 10) for k in range(5000)])
    assert paced(times)[1] == []


def test_neither_does_the_fastest_clock_that_can_allows_within_an_hour():
    assert paced(np.arange(360_000) * SHORTEST_US)[1] == []


@pytest.mark.parametrize("waiting", [2, 5, 20])
def test_frames_that_waited_and_come_at_once_are_those_of_one_producer(waiting):
    """The reader, or the bus, was busy for so many periods."""
    times = [PERIOD_US * (k - k % waiting + waiting if (k // 100) % 2 else k) for k in range(1000)]
    assert paced(sorted(times))[1] == []


def test_a_frame_that_can_delivers_twice_is_no_second_producer():
    times = [PERIOD_US * k for k in range(100)]
    assert paced(sorted([*times, times[50] + 200]))[1] == []


@pytest.mark.parametrize("rate", [5.0, 10.0, 20.0, 100.0, 1000.0])
def test_a_second_producer_is_noticed_by_its_fourth_frame_and_the_alarm_lasts_as_long(rate):
    jitter = 0.3
    for seed in range(20):
        rng = np.random.default_rng(seed)
        alien = 5e6 + 1e6 / rate * (rng.random() + np.arange(int(10 * rate)))
        doubled, alarms = paced(np.sort([*late(2000, rng, jitter), *alien]))
        assert alien[0] <= alarms[0] <= alien[3] + PERIOD_US
        assert max(np.diff(alarms)) < QUIET_US
        assert alarms[-1] <= alien[-1] + jitter / FAST_CLOCK * PERIOD_US
        assert doubled(alarms[-1] + QUIET_US - 1)
        assert not doubled(alarms[-1] + QUIET_US)


def test_a_clock_that_leaps_is_no_second_producer():
    for leap in (-3_600_000_000, -5_000, 60_000_000):
        times = [PERIOD_US * k + (leap if k >= 500 else 0) for k in range(1000)]
        assert paced(times)[1] == []


class Kept(NamedTuple):
    """State of the service before an event, with the event's number."""

    event: int
    state: WeighingService


class Work(NamedTuple):
    """The service, one cycle's events, the masses dug, and the state at every tenth of a second, by its number."""

    core: Core
    events: list
    masses: list
    states: dict[int, Kept]


@pytest.fixture(scope="module")
def work():
    """The service while it works."""
    loaded = load(EXCAVATOR)
    core = Core(loaded.service, identified(loaded))
    events, masses = cycles(loaded, count=1)
    state, states = WeighingService.start(core), {}
    for k, event in enumerate(events):
        if isinstance(event, Tick) and round(100 * seconds(event)) % 10 == 0:
            states[round(10 * seconds(event))] = Kept(k, state.copied())
        fed(state, event)
    return Work(core, events, masses, states)


def mixed(events, alien):
    """Both streams in order of time."""
    return sorted([*events, *alien], key=lambda event: event.t_us)


def aliens(core, events, signal, rate, begin, share):
    """A second producer of a signal's PDO from `begin` [s] on: what it says is `share` of what the sensor says."""
    pdo = pdo_of(core.service, signal)
    field = next(f for f in pdo.fields if f.signal == signal)
    rng, due, made = np.random.default_rng(int(rate)), begin, []
    for event in events:
        if isinstance(event, Frame) and event.can_id == pdo.can_id and seconds(event) >= due:
            value = share * decode(pdo, event.data)[signal]
            data = with_raw(event.data, pdo, signal, round((value - field.offset) / field.scale))
            made.append(Frame(event.t_us + int(rng.integers(500, 9_000)), pdo.can_id, data))
            due += 1.0 / rate
    return made


@pytest.mark.parametrize("rate", [5.0, 20.0])
def test_a_second_producer_makes_its_signal_unusable_and_books_nothing_wrong(work, rate):
    core, events, states = work.core, work.events, work.states
    begin = 4.0
    at, state = states[round(10 * begin)].event, states[round(10 * begin)].state.copied()
    alien = aliens(core, events, "boom_head_pressure", rate, begin, 0.8)
    shown, bookings = [], []
    for event in mixed(events[at:], alien):
        out = fed(state, event)
        if out.estimate is not None:
            shown.append((seconds(event), out.estimate))
            if (booking := out.estimate.booking) and booking.number > len(bookings):
                bookings.append(booking)
    noticed = next(t for t, e in shown if e.gross.reason is Reason.TWO_PRODUCERS)
    assert noticed - (alien[0].t_us - START_US) * 1e-6 < 3.1 / rate
    end = (alien[-1].t_us - START_US) * 1e-6
    between = [e for t, e in shown if noticed <= t < end]
    assert {e.gross.status for e in between} == {Status.INVALID}
    assert {e.force.magnitude.status for e in between} == {Status.INVALID}
    assert all(abs(b.mass - work.masses[0]) < 3.0 * b.standard_error for b in bookings)


def test_a_heartbeat_that_stops_while_its_pdos_go_on_ends_the_measurement_until_it_is_back(work):
    core, events, states = work.core, work.events, work.states
    node = core.service.nodes[0]
    begin, back = 4.0, 9.0
    at, state = states[round(10 * begin)].event, states[round(10 * begin)].state.copied()
    reasons = []
    for event in events[at:]:
        beat = isinstance(event, Frame) and event.can_id == 0x700 + node.node_id
        if beat and begin <= seconds(event) < back:
            continue
        out = fed(state, event)
        if out.estimate is not None:
            reasons.append((seconds(event), out.estimate.gross.reason))
    first = next(t for t, reason in reasons if reason is Reason.NOT_OPERATIONAL)
    assert first - begin <= 3.0 * node.heartbeat_s + 0.02
    last = max(t for t, reason in reasons if reason is Reason.NOT_OPERATIONAL)
    assert back <= last <= back + node.heartbeat_s


def test_a_node_that_says_it_is_not_operational_is_not_believed(work):
    core = work.core
    state = work.states[40].state.copied()
    node = core.service.nodes[0]
    t = state.estimate.t_us
    carried = {k for pdo in node.pdos for k, s in enumerate(core.service.machine.signals) if s.name in names(pdo)}
    for told, expected in ((5, set()), (127, carried), (4, carried), (5, set())):
        fed(state, Frame(t, 0x700 + node.node_id, bytes([told])))
        state.receive()
        reasons = state.inputs.sample(t).reasons
        found = {k: reason for k, reason in enumerate(reasons) if reason is not Reason.NONE}
        assert set(found) == expected
        assert set(found.values()) <= {Reason.NOT_OPERATIONAL}


@pytest.mark.parametrize(("booted", "missed"), [(True, True), (False, False)])
def test_a_node_that_booted_must_send_heartbeats_and_one_that_never_did_need_not(booted, missed):
    service = load(EXCAVATOR).service
    inputs = assembler(service)
    node, pdo = inputs.constants.supervisor.pdos[0]
    patience = int(3e6 * node.heartbeat_s)
    if booted:
        inputs.restart(node.node_id)

    def lost(t):
        inputs.receive([Frame(t, pdo.can_id, bytes(8))])
        reasons = inputs.sample(t).reasons
        return any(reasons[k] is Reason.NOT_OPERATIONAL for k in carried)

    carried = [k for k, s in enumerate(service.machine.signals) if s.name in names(pdo)]
    beginning = int(1e4 * service.health.good_frames)  # the signals of a node that booted are not used yet
    for t in range(1_000_000, 1_000_000 + patience + 1, PERIOD_US):
        assert not lost(t) or t < 1_000_000 + beginning
    assert lost(1_000_000 + patience + 1) is missed


def test_a_heartbeat_that_was_never_heard_is_not_begun_by_pdos():
    """Of no node: its PDOs come unevenly, then not for longer than its patience, then again."""
    inputs = assembler(load(EXCAVATOR).service)
    supervisor = inputs.constants.supervisor
    pdos, patience = supervisor.pdos, int(max(supervisor.patience_us))
    for t in (0, 4_000, 14_000, 18_000, 18_000 + 2 * patience):
        sent = [Frame(1_000_000 + t + k, pdo.can_id, bytes(8)) for k, (_, pdo) in enumerate(pdos)]
        inputs.receive(sent)
    assert any(pdo.excess for pdo in inputs.pdos)
    assert {node.t_us for node in inputs.nodes} == {NEVER}


def names(pdo):
    return {field.signal for field in pdo.fields}


def test_our_own_identifier_from_somebody_else_degrades_for_two_seconds(work):
    core, events, states = work.core, work.events, work.states
    ours = core.service.publication[0].can_id
    ok = next(k for k, (_, s) in sorted(states.items()) if s.estimate.gross.status is Status.OK)
    at, state = states[ok].event, states[ok].state.copied()
    fed(state, Frame(state.estimate.t_us, ours, bytes(8)))
    begin, reasons = state.estimate.t_us, []
    for event in events[at : at + 4000]:
        out = fed(state, event)
        if out.estimate is not None and out.estimate.force.x.status is not Status.INVALID:
            reasons.append((event.t_us - begin, out.estimate.force.x.status, out.estimate.force.x.reason))
    during = {status for t, status, _ in reasons if t < QUIET_US}
    assert during == {Status.DEGRADED}
    assert any(reason is Reason.OWN_IDENTIFIER for _, _, reason in reasons)
    assert not any(reason is Reason.OWN_IDENTIFIER for t, _, reason in reasons if t >= QUIET_US)


def test_our_own_identifier_from_somebody_else_changes_nothing_else():
    untouched = assembler(SERVICE)
    for can_id in sorted(untouched.constants.supervisor.ours):
        inputs = assembler(SERVICE)
        inputs.receive([Frame(1_000_000, can_id, bytes(8))])
        for part in ("channels", "pdos", "nodes", "long_us"):  # as text, in which a value that is absent equals itself
            assert repr(getattr(inputs, part)) == repr(getattr(untouched, part))
        assert inputs.counters == replace(untouched.counters, unknown=1.0)
        assert (inputs.spoofed(1_000_000), inputs.spoofed(1_000_000 + QUIET_US)) == (True, False)


def test_requests_to_us_are_nobody_elses():
    supervisor, own = Supervisor(SERVICE), SERVICE.node_id
    assert not supervisor.ours & {0, 0x80, 0x600 + own}
    assert {0x180 + own, 0x580 + own, 0x700 + own, 0x80 + own} <= supervisor.ours


def test_frames_do_not_pile_up_without_ticks(work):
    """A flood between two ticks: the state stays as large as it was, and every frame is judged."""
    state = work.states[40].state.copied()
    state.receive()
    counted = state.inputs.counters.unknown
    for k in range(1000):
        fed(state, Frame(state.estimate.t_us + k, 0x123, b""))
        assert len(state.frames) < MOST_FRAMES
    state.receive()
    assert state.inputs.counters.unknown - counted == 1000
