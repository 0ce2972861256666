"""Half a million arbitrary frames, a million with `--all`: no exception, no warning, no NaN where a value is promised,
and OK always means it."""

import os
import struct
from itertools import chain, cycle

import numpy as np
import pytest

from cylforce.service.core import Core
from cylforce.service.plausibility.suspicion import Level
from cylforce.service.publication import frames
from cylforce.service.published_values import DIRECTION, FORCE_X, FORCE_Z, GROSS, MAGNITUDE, NET
from cylforce.service.service import WeighingService
from cylforce.settings.machine_file import load
from cylforce.signals.codec import decode, encode
from cylforce.signals.estimate import Reason, Status
from cylforce.signals.events import ERROR, EXTENDED, REMOTE, Frame, Tick
from cylforce.signals.kinds import Kind
from cylforce.simulation.scenario import posture_at
from scenarios import CONFIG, cycles, fed, identified, pdo_of, played, scene

FRAMES = 1_000_000
STRETCH = 900  # ticks of good motion in a row, more or less spoiled
CYCLES = (
    5_000  # with three working cycles: a machine of two joints must have seen its empty bucket before its weight is OK
)
CALM, CALM_OF_TWO_JOINTS = 1_200, 7_000  # ticks of good motion at the beginning, until a loaded bucket is weighed
LONGER, MISSING = 20, 5  # ticks after them with too long frames, then with frames missing
NONSENSE = 250  # ticks of motion that cannot be
BURST = 25_000  # arbitrary frames after each
SPOILED = (0.0, 0.0, 1e-4, 1e-3, 1e-2, 0.1)  # shares of the frames of a stretch
HOUR = 3_600_000_000


class Source:
    """Events to feed, none like the other; every draw comes from one seed."""

    def __init__(self, loaded, core, rng, ticks):
        self.rng, self.core, self.ticks, service = rng, core, ticks, loaded.service
        pdos = [pdo for node in service.nodes for pdo in node.pdos]
        own = service.node_id
        self.pdos, self.signals = pdos, service.machine.signals
        self.known = [pdo.can_id for pdo in pdos]
        special = [0x000, 0x080, 0x600 + own, 0x580 + own, *(p.can_id for p in service.publication)]
        self.known += special + [0x700 + node.node_id for node in service.nodes]
        begin = posture_at(service.machine, (0.5, 0.6, 0.6))
        size = service.machine.size
        strokes = [(j, 0.2 + k * 3.0 + j, 3.0 + k * 3.0 + j, 0.3 * (-1) ** k) for j in range(size) for k in range(5)]
        calm = played(loaded, [scene(begin, strokes, 15.0, 700.0)])
        self.good = cycle(chain(calm, cycles(loaded, count=3)[0]))
        self.shares, self.now = cycle(SPOILED), 1_700_000_000_000_000

    def opening(self, calm):
        """Good motion with a loaded bucket, by which every status occurs, whatever the seed: INVALID at the start, then
        OK, DEGRADED while frames are too long, HOLD while the frames of one PDO are missing."""
        missing, shift, ticks = self.pdos[0].can_id, None, 0
        while ticks < calm + LONGER + MISSING:
            event = next(self.good)
            if shift is None:
                shift = self.now - event.t_us
            event = event._replace(t_us=event.t_us + shift)
            self.now = event.t_us
            ticks += isinstance(event, Tick)
            if isinstance(event, Tick) or ticks < calm:
                yield event
            elif ticks < calm + LONGER:
                yield event._replace(data=event.data + b"\0")
            elif event.can_id != missing:
                yield event

    def stretch(self):
        """Good motion, a share of whose frames is cut, filled, flipped, doubled, dropped or made foreign; the clock
        goes on, or has stepped."""
        share = next(self.shares)
        self.now = max(0, self.now + int(self.rng.choice([10_000, 10_000, HOUR, -HOUR, 777, -50_000_000_000_000])))
        ticks, shift, last = 0, None, self.now
        while ticks < self.ticks:
            event = next(self.good)
            if shift is None or event.t_us + shift < last - 100_000:
                shift = last + 10_000 - event.t_us
            event = event._replace(t_us=event.t_us + shift)
            last = event.t_us
            ticks += isinstance(event, Tick)
            yield from self.spoil(event) if self.rng.random() < share else (event,)
        self.now = last

    def spoil(self, event):
        if isinstance(event, Tick):
            off = int(self.rng.choice([0, 3_000, -3_000, 40_000, 200_000, HOUR, -HOUR]))
            return [event._replace(t_us=max(0, event.t_us + off))] * int(self.rng.integers(0, 3))
        data = bytearray(event.data)
        match int(self.rng.integers(0, 7)):
            case 0:
                return []
            case 1:
                return [event, event]
            case 2:
                return [event._replace(data=bytes(data[: int(self.rng.integers(0, len(data) + 1))]))]
            case 3:
                return [event._replace(data=bytes(data) + self.rng.bytes(int(self.rng.integers(1, 5))))]
            case 4:
                return [event._replace(can_id=event.can_id | int(self.rng.choice([EXTENDED, REMOTE, ERROR])))]
            case 5:
                return [event._replace(data=self.rng.bytes(len(data)))]
            case _:
                data[int(self.rng.integers(len(data)))] ^= 1 << int(self.rng.integers(8))
                return [event._replace(data=bytes(data))]

    def nonsense(self):
        """Every signal swings anywhere in its range, in its own time, so that it is believed, but no machine could move
        like that: pressures against the motion, dead points, end stops, slopes."""
        low, high = np.array([(s.low, s.high) for s in self.signals]).T
        middle, size = (low + high) / 2.0, (high - low) / 2.0 * self.rng.choice([0.1, 0.5, 1.0], len(low))
        pace = self.rng.uniform(0.0, 1.0, len(low)) * np.minimum(2.5 / np.maximum(size, 0.1), 20.0)
        size = np.where([s.kind in (Kind.PITCH, Kind.ROLL) for s in self.signals], 0.15, size)
        phase, noise = self.rng.uniform(0.0, 7.0, len(low)), np.array([s.standard_error for s in self.signals])
        names = [s.name for s in self.signals]
        for pdo in self.pdos:  # newly booted nodes have not said anything that would make this a leap
            yield Frame(self.now, 0x700 + pdo.node_id, b"\0")
        for _ in range(NONSENSE):
            self.now += 10_000
            yield Tick(self.now)
            values = middle + size * np.sin(pace * self.now * 1e-6 % 1e4 + phase)
            values = np.clip(values + noise * self.rng.standard_normal(len(low)), low, high)
            sent = dict(zip(names, values.tolist(), strict=True))
            for k, pdo in enumerate(self.pdos):
                yield Frame(self.now + 300 + 250 * k, pdo.can_id, encode(pdo, sent))

    def burst(self):
        """Arbitrary frames, half of them with identifiers that matter; commands among them; a tick now and then, at
        arbitrary distances, also backwards."""
        n, rng = BURST, self.rng
        any_id = rng.integers(0, 1 << 32, n, dtype=np.uint64) >> rng.choice([0, 3, 21], n).astype(np.uint64)
        known = np.array(self.known, dtype=np.uint64)[rng.integers(0, len(self.known), n)]
        ids = np.where(rng.random(n) < 0.5, known, any_id).tolist()
        lengths = np.where(rng.random(n) < 0.6, 8, rng.integers(0, 9, n)).tolist()
        steps = rng.choice([0, 100, 1_000, 10_000], n).tolist()
        data, ticks = rng.bytes(8 * n), (rng.random(n) < 0.004).tolist()
        for k, (can_id, length, wait, tick) in enumerate(zip(ids, lengths, steps, ticks, strict=True)):
            self.now += wait
            yield Frame(self.now, can_id, data[8 * k : 8 * k + length])
            if k % 100 == 0:
                yield self.command(k // 100)
            if tick:
                off = int(rng.choice([0, 0, 0, 10_000, 100_000, HOUR, -10_000, -HOUR]))
                self.now = max(0, self.now + off)
                yield Tick(self.now)

    def command(self, k):
        index, name = ((0x6125, b"zero"), (0x6139, b"tare"))[k % 2]
        first = 0x23 if k % 3 else int(self.rng.integers(256))
        return Frame(self.now, 0x600 + self.core.service.node_id, struct.pack("<BHB", first, index, 1) + name)


class Judge:
    """Looks at what comes out; counts how often each status was reached."""

    def __init__(self, core):
        self.core, self.publication = core, core.service.publication
        self.rated = core.service.machine.rated_payload
        self.limits = {f.signal: (f.low, f.high) for pdo in self.publication for f in pdo.fields}
        self.seen = dict.fromkeys(Status, 0)

    def look(self, out):
        if out.verdict is not None:
            assert out.verdict in (0, 0x08000022, 0x06090030)
        if out.estimate is None:
            return
        e = out.estimate
        force = dict(zip((FORCE_X, FORCE_Z, MAGNITUDE, DIRECTION), e.force.quantities, strict=True))
        for name, q in {GROSS: e.gross, NET: e.net, **force}.items():
            self.quantity(q, *self.limits[name])
        for q in e.load.quantities:
            self.quantity(q, -1e9, 1e9)
        self.seen[e.gross.status] += 1
        for q in (e.gross, e.net):
            assert q.status is not Status.OK or 0.0 < q.standard_error < self.rated
        if e.booking is not None:
            assert e.booking.number > 0
            assert np.isfinite(e.booking.mass)
            assert 0.0 < e.booking.standard_error <= self.rated
        self.frames(e, dict(frames(self.publication, e)))

    def quantity(self, q, low, high):
        if q.status is Status.INVALID:
            assert q.value != q.value
            assert q.reason is not Reason.NONE
            return
        assert low <= q.value <= high
        assert 0.0 < q.standard_error < float("inf")
        assert (q.status is Status.OK) == (q.reason in (Reason.NONE, Reason.NO_CONTACT))

    def frames(self, e, frames):
        """Every frame decodes to values within their declared ranges, or to "not available" where there is none."""
        found = {}
        for pdo in self.publication:
            assert len(frames[pdo.number]) == pdo.length <= 8
            found |= decode(pdo, frames[pdo.number])
        for name, value in found.items():
            low, high = self.limits[name]
            assert not np.isfinite(value) or low - 1e-9 <= value <= high + 1e-9
        for name, q in ((GROSS, e.gross), (NET, e.net), (MAGNITUDE, e.force.magnitude)):
            assert np.isfinite(found[name]) == (q.status is not Status.INVALID)
        assert Status(int(found["payload_quality"]) & 3) is e.gross.status
        assert Reason(int(found["payload_quality"]) >> 2) is e.gross.reason


def machine(name, real):
    """A machine file's service and its tares; `real`: with pressures as REAL32, which can say NaN and infinity."""
    loaded = load(CONFIG / name)
    tares, service = identified(loaded), loaded.service
    if real:
        pressures = {s.name for s in service.machine.signals if s.name.endswith("pressure")}
        swapped = pdo_of(service, min(pressures))
        fields = tuple(type(f)(f.signal, f.index, f.sub, "f", 1.0, 0.0, f.unit, f.low, f.high) for f in swapped.fields)
        nodes = tuple(
            n._replace(pdos=tuple(p._replace(fields=fields) if p is swapped else p for p in n.pdos))
            for n in service.nodes
        )
        loaded = loaded._replace(service=service._replace(nodes=nodes))
    return loaded, Core(loaded.service, tares)


@pytest.mark.parametrize(
    ("name", "real", "stretch", "calm"),
    [
        ("excavator_20t.toml", False, STRETCH, CALM),
        pytest.param("excavator_stick_bucket.toml", True, CYCLES, CALM_OF_TWO_JOINTS, marks=pytest.mark.long),
    ],
)
def test_a_million_arbitrary_frames(name, real, stretch, calm):
    """Half a million for each of two machines, one of them `long`: arbitrary frames, good motion of which a share is
    spoiled, and motion that cannot be; more than 10 000 ticks each. Nothing raises or warns, every status OK is honest,
    every published frame decodes. Every status occurs in an opening that does not depend on the seed."""
    seed = int(os.environ.get("CYLFORCE_FUZZ_SEED", "1"))
    print(f"CYLFORCE_FUZZ_SEED={seed}")
    loaded, core = machine(name, real)
    source, judge = Source(loaded, core, np.random.default_rng(seed), stretch), Judge(core)
    state, frames, ticks = WeighingService.start(core), 0, 0
    for event in source.opening(calm):
        out = fed(state, event)
        judge.look(out)
    print("opening", {s.name: n for s, n in judge.seen.items()})
    assert min(judge.seen.values()) > 0
    while frames < FRAMES // 2:
        if (
            state.monitor.suspicion.level is Level.REJECTED
        ):  # sensors that contradict each other: a new start is the cure
            state = WeighingService.start(core)
        for event in chain(source.stretch(), source.nonsense(), source.burst()):
            out = fed(state, event)
            judge.look(out)
            ticks += isinstance(event, Tick)
            frames += isinstance(event, Frame)
    print(frames, "frames", ticks, "ticks", {s.name: n for s, n in judge.seen.items()})
    assert ticks > 10_000
