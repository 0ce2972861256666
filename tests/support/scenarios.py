"""Simulated machines at work as lists of events, for tests that then spoil those events."""

import struct
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cylforce.commissioning.identification import identify
from cylforce.programs.common.play import prepare
from cylforce.programs.common.readings import model_of
from cylforce.programs.sim import START_US
from cylforce.service.service import WeighingService
from cylforce.signals.codec import decode
from cylforce.signals.estimate import Estimate
from cylforce.signals.events import Tick
from cylforce.signals.layout import CODES
from cylforce.simulation.sensing import run, sensors
from cylforce.simulation.sensor_bus import bus_events
from cylforce.simulation.simulator import draw_truth
from cylforce.simulation.soil import Dig
from cylforce.simulation.trajectory import JointCourse, Move, Phase, Scene

CONFIG = Path(__file__).resolve().parents[2] / "config"
EXCAVATOR = CONFIG / "excavator_20t.toml"
SMALL = CONFIG / "excavator_stick_bucket.toml"  # two cylinders: a quarter of the corrections, half of the parameters
SEED = 3
GRAB = """
[[attachments]]
name = "grab"
kind = "grab"
mass_kg = 1100
centre_m = [0.75, 0.2]
point_m = [1.6, 0.0]
rated_payload_kg = 1300
"""


def at_rate(loaded, rate_hz):
    """The machine with sensors that are read, and a service that steps, at another rate [Hz]."""
    service = loaded.service
    return loaded._replace(service=service._replace(filters=service.filters.at(rate_hz)))


def moved(loaded, seed=SEED, seconds=60.0):
    """Samples (T, S) of the empty machine's moves, the caller's own."""
    return _moved(loaded, seed, seconds).copy()


@lru_cache(8)
def _moved(loaded, seed, seconds):
    return np.concatenate([r.values for r in prepare(loaded, "moves", seed, 0.1, amount=seconds).records])


def identified(loaded, seed=SEED, seconds=60.0):
    """Tares from such moves, with the common scale of the pressures known as after a lift of a known weight."""
    return _identified(loaded, seed, seconds)


@lru_cache(32)
def _identified(loaded, seed, seconds):
    """Identified once for all tests of a process: none of them changes the tares' arrays."""
    tares = identify(model_of(loaded), [_moved(loaded, seed, seconds)]).tares._replace(common_error=0.0)
    for array in (tares.values, tares.covariance, tares.row_error):
        array.flags.writeable = False
    return tares


def cycles(loaded, seed=SEED, count=2):
    """Events of digging cycles, and the masses dug."""
    play = prepare(loaded, "cycles", seed, 0.1, amount=count)
    records = list(play.records)
    rng = np.random.default_rng((seed, 3))
    return list(bus_events(play.service, play.made, records, START_US, rng)), [
        float(record.physics.load.mass.max()) for record in records[1:]
    ]


def truth_of(loaded, seed=SEED):
    """The machine that all of a seed's runs are of."""
    return draw_truth(loaded.service.machine, np.random.default_rng((seed, 0)), 0.1)


def carried(mass):
    """A load that hangs in the bucket from beginning to end."""
    return Dig(-2.0, -1.0, 1e6, 2e6, mass, (0.7, 0.1), (0.0, 0.0), np.zeros((0, 3)))


def scene(begin, strokes, seconds, mass=0.0):
    """Joints at angles `begin` [rad] that make `strokes`: (joint, start [s], stop [s], rise [rad])."""
    courses = tuple(
        JointCourse(angle, tuple(Move(*stroke) for joint, *stroke in strokes if joint == j))
        for j, angle in enumerate(begin)
    )
    return Scene(seconds, courses, JointCourse(0.0), ((0.0, Phase.AIR),), carried(mass) if mass else None)


def played(loaded, scenes, seed=SEED):
    """Events of scenes."""
    service = loaded.service
    made = sensors(service.machine, service.nodes)
    rng = np.random.default_rng((seed, 2))
    records = run(service.machine, truth_of(loaded, seed), made, scenes, dt=1.0 / service.filters.rate_hz, rng=rng)
    return list(bus_events(service, made, records, START_US, np.random.default_rng((seed, 3))))


def seconds(event):
    """From the start of the run."""
    return (event.t_us - START_US) * 1e-6


def pdo_of(service, signal):
    """The PDO that carries a signal."""
    pdos = (pdo for node in service.nodes for pdo in node.pdos)
    return next(p for p in pdos if any(f.signal == signal for f in p.fields))


def with_pdo(events, pdo, change, begin=0.0, end=np.inf):
    """The events with one PDO's frames from `begin` to `end` [s] replaced by what `change(frame)` gives: a frame, or
    None for none."""
    of_pdo = (
        change(e) if not isinstance(e, Tick) and e.can_id == pdo.can_id and begin <= seconds(e) < end else e
        for e in events
    )
    return [event for event in of_pdo if event is not None]


def with_raw(data, pdo, signal, raw):
    """A PDO's data with one field's raw value set, whatever the field's range."""
    at = 0
    for field in pdo.fields:
        size = CODES[field.code]
        if field.signal == signal:
            return data[:at] + struct.pack("<" + field.code, raw) + data[at + size :]
        at += size
    raise AssertionError(signal)


def with_value(events, service, signal, change, begin=0.0, end=np.inf):
    """The events with one signal's SI values replaced: `change(seconds, value)`."""
    pdo = pdo_of(service, signal)
    field = next(f for f in pdo.fields if f.signal == signal)

    def edited(frame):
        wanted = change(seconds(frame), decode(pdo, frame.data)[signal])
        raw = (wanted - field.offset) / field.scale
        return frame._replace(data=with_raw(frame.data, pdo, signal, raw if field.code == "f" else round(raw)))

    return with_pdo(events, pdo, edited, begin, end)


class Outcome(NamedTuple):
    """What an event brought: the estimate of a tick; verdict and words of the answer to a command."""

    estimate: Estimate | None = None
    verdict: int | None = None
    words: str = ""


def fed(service, event):
    """The outcome of one more event."""
    if isinstance(event, Tick):
        return Outcome(service.on_tick(event.t_us))
    answer = service.on_frame(event)
    return Outcome() if answer is None else Outcome(None, answer.verdict, answer.words)


def through(core, events, service=None):
    """The service over events, from a copy of `service` on: (the service afterwards, estimates of all ticks, verdicts
    on commands)."""
    service = WeighingService.start(core) if service is None else service.copied(core)
    outcomes = [fed(service, event) for event in events]
    estimates = [out.estimate for out in outcomes if out.estimate is not None]
    return service, estimates, [out.verdict for out in outcomes if out.verdict is not None]
