"""Has a pressure leapt as no oil does? In contact any force is possible, so that a pressure that is wrong contradicts
nothing until the next motion in the air. But the moment shows in which it becomes wrong. Within 0.15 s pressures follow
a curve, or all of them are hit; one that is exchanged, dead or shifted leaps by itself, between two messages.

Curves (polynomials) through the last readings are compared. Two signals are exchanged if each goes on where the other
one was: curves through the first readings of one and the last ones of the other have a smaller residual. One signal
steps if a curve with a step has one. The measure is the log likelihood ratio, with the noise of the residual, but at
least the sensor's. Either must also be more probable than a blow, by which every pressure may step or do anything.

A leap shows *when* a signal became wrong, but not for certain *that* it did. The next seconds in the air decide: then
one load must explain the torques of all joints. If a signal stepped, it must explain them better without that step; if
signals were exchanged, it hardly ever explains them at all, so that some seconds in a row that a load explains end the
suspicion. A step that is not confirmed ends by itself: when as many seconds of motion as `constant_error` keeps have
been of the time after it, some of them in the air, there is no older evidence to wait for."""

from array import array
from dataclasses import dataclass
from math import exp, inf, log, pi, sqrt
from typing import ClassVar, Self

import numpy as np

from cylforce.estimation.kernel import choice
from cylforce.estimation.kernel.functions import Kernel
from cylforce.estimation.kernel.making import counts, numbers
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solving import ZERO
from cylforce.mechanics.machine import Machine
from cylforce.service.plausibility.blocks import BAR, EVERY, SAMPLES, Block, cost
from cylforce.service.plausibility.constant_error import KEPT as KEPT_SECONDS
from cylforce.service.plausibility.constant_error import VOTES
from cylforce.service.plausibility.detector import Description, Detector, Features, Interruption, MonitoredMachine
from cylforce.service.plausibility.pressure_groups import picker, pressures
from cylforce.service.plausibility.reversals import ReversalConstants, Reversals
from cylforce.service.plausibility.suspicion import NOTHING_SUSPECTED, Level, SensorDoubt, SensorFault
from cylforce.service.snapshot import Constants
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import SIDES, Kind

# Readings before and after a leap, and the degree of the curves. Chosen on foreign machines 1 to 5 (tools/faulting)
BEFORE, AFTER, DEGREE = 10, 5, 3
FREE = BEFORE + AFTER - DEGREE - 2  # degrees of freedom of the residual of a curve with a step
# Readings, in pieces as long as these, from which the noise before is known; their residual counts as much as the
# present one (degrees of freedom of Student's t). Chosen on the same: noise changes from second to second
PIECES, KNOWN = 6, FREE
WINDOW = BEFORE + AFTER
# Bits of `late`: all that are kept; the last two readings before a leap and the first one after it. Of frames that
# waited and come together a tick may find some: the reading after a late one may be old, too.
RECENT, BESIDE = (1 << WINDOW) - 1, 0b111 << (AFTER - 1)
KEPT = PIECES * WINDOW
LONGEST = KEPT + WINDOW
# Log likelihood ratio of a leap: an order of signals that is right exceeds it once in ten hours, if each of its
# moments is tested for each leap (Markov's inequality: the ratio's mean is one)
HOURS = 10.0
RESOLVED = 100.0  # Pa: less is not resolved by any such sensor; 0.00025 % of 400 bar

WRONGLY = 0.01  # probability with which the suspicion of a fault ends (Wald's sequential test); by convention
ENOUGH = -2.0 * log(WRONGLY)  # votes, twice the log likelihood ratio, that end it
MOST = ENOUGH / VOTES  # of one second: several must agree

Pairs = tuple[tuple[int, int], ...]


class LeapTest:
    """The comparison of curves through the readings of one machine's pressures.

    signals:   (P,) numbers of the pressures
    exchanges: what may be exchanged, as numbers of pressures: the sides of a cylinder; two cylinders' nodes
    every:     steps between two readings: no signal is repeated because it is sent less often
    least:     log likelihood ratio from which on a leap is suspected; infinite for a machine without pressures
    gate:      (P,) change within a reading below which nothing is tested: half of the least leap that could be
               suspected, that of two signals [Pa]
    """

    def __init__(self, machine: Machine, rate_hz: float, kernel: Kernel | None = None) -> None:
        self.kernel, self.signals = kernel or choice.chosen(), pressures(machine)
        own = [machine.signals[k] for k in self.signals]
        self.exchanges = _exchanges(machine)
        self.every = max(1, round(max((s.period_s for s in own), default=0.0) * rate_hz))
        tests = 3600.0 * HOURS * rate_hz * (len(own) + len(self.exchanges))
        self.least = log(tests) if tests else inf
        self._noise = np.array([max(s.standard_error, RESOLVED) ** 2 for s in own])  # variance (P,) [Pa^2]
        self._curves = _curves()
        self._rise = float(self._curves[BEFORE:, -1].sum())  # of the orthonormal step
        widths = np.log(np.array([s.high - s.low for s in own]) / np.sqrt(2.0 * pi * self._noise))
        # Occam factors (P,) [nats], widths of the prior over those of the posterior: a step may be of any size that the
        # sensor can show, either way; all readings after a blow may be anything
        self._any_step = widths + log(2.0 * abs(self._rise))
        self._anything = AFTER * (widths - 0.5)
        self.gate = self._gate()
        # the pairs of each exchange as the kernel takes them, and the most that one has
        self._most_pairs = max(map(len, self.exchanges), default=0)
        filled = [(*pairs, *[(-1, -1)] * (self._most_pairs - len(pairs))) for pairs in self.exchanges]
        self._pairs = counts(p for pairs in filled for pair in pairs for p in pair)

    def _gate(self) -> Numbers:
        many = 2 * (FREE + KNOWN)
        squares = min(FREE * (exp(self.least / FREE) - 1.0), 0.5 * many * (exp(4.0 * self.least / many) - 1.0))
        return numbers(0.5 * (sqrt(squares) / abs(self._rise)) * np.sqrt(self._noise))

    def leap(self, readings: Array) -> SensorDoubt:
        """Return what leapt between the last AFTER `readings` (T, P) [Pa] and the BEFORE that are before them; the
        others show the noise, if there are LONGEST."""
        window = np.ascontiguousarray(readings[-WINDOW:])
        size, bends = window.shape[1], DEGREE + 1
        limits = (self._curves, bends, self._noise, float(FREE), float(KNOWN), self.least)
        exchanges = (self._pairs, len(self.exchanges), self._most_pairs)
        room, misfit = ZERO * (2 * size * (bends + 2)), ZERO * (2 * size)
        # 1: a step is certain, 2: an exchange, 3: both
        found = self.kernel.sure_leaps(size, window, len(window), BEFORE, *limits, *exchanges, room, misfit)
        swapped = self._swapped(window, *np.frombuffer(misfit).reshape(2, size)) if found > 1 else ()
        if swapped:
            signals = tuple(sorted(self.signals[p] for pair in swapped for p in pair))
            return SensorDoubt(Level.DOUBTED, SensorFault.SWAPPED, signals)
        return self._stepped(window, readings[:-WINDOW]) if found % 2 else NOTHING_SUSPECTED

    def _stepped(self, window: Array, earlier: Array) -> SensorDoubt:
        """Return the pressure that stepped alone, if one did."""
        along = self._curves.T @ (window - window[0])
        left = ((window - window[0]) ** 2).sum(axis=0) - (along**2).sum(axis=0)
        known = self._noise_before(earlier)
        plain, stepped = self._unlikely(left + along[-1] ** 2, known), self._unlikely(left, known)
        most = int(np.argmax(plain - stepped))
        alone = -float(plain.sum() - plain[most] + stepped[most] + self._any_step[most])
        if plain[most] - stepped[most] <= self.least or alone <= self._blow(plain, stepped):
            return NOTHING_SUSPECTED
        size = float(along[-1, most] / self._rise)
        return SensorDoubt(Level.DOUBTED, SensorFault.STEPPED, (self.signals[most],), size)

    def _noise_before(self, earlier: Array) -> Array | None:
        """Return the variance (P,) [Pa^2] of the residual of curves through readings (T, P) before; None of too few."""
        if len(earlier) < KEPT:
            return None
        pieces = earlier.reshape(PIECES, WINDOW, -1) - earlier.reshape(PIECES, WINDOW, -1)[:, :1]
        left = (pieces**2).sum(axis=1) - ((self._curves[:, :-1].T @ pieces) ** 2).sum(axis=1)
        return np.asarray(np.maximum(left.mean(axis=0) / (FREE + 1), self._noise))

    def _unlikely(self, left: Array, known: Array | None) -> Array:
        """Return minus the log likelihood [nats] of a residual `left`, in squares [Pa^2]: Student's, if the variance
        before is `known`."""
        if known is None:
            return self._misfit(left, self._noise)
        share = (KNOWN + left / known) / (KNOWN + FREE)
        return np.asarray(0.5 * (FREE + KNOWN) * np.log(np.maximum(share, 1.0)))

    def _blow(self, plain: Array, stepped: Array) -> float:
        """Return the log likelihood [nats] that all pressures are hit: each is as likely to go on, to step, or to do
        anything."""
        either = np.logaddexp(np.logaddexp(-plain, -stepped - self._any_step), -self._anything)
        return float(np.sum(either - log(3.0)))

    def _misfit(self, left: Array, noise: Array) -> Array:
        """Return minus the log likelihood [nats] of a residual `left`, in squares [Pa^2], of a variance of its own, but
        at least the `noise` [Pa^2]; 0: no more than that."""
        return np.asarray(0.5 * FREE * np.log(np.maximum(left / (FREE * noise), 1.0)))

    def _crossed(self, window: Array) -> Array:
        """Return the residual of curves through the first readings of one pressure and the last ones of another, in
        squares (P, P) [Pa^2]."""
        curves, first, last = self._curves[:, :-1], window[:BEFORE], window[BEFORE:]
        one, other = curves[:BEFORE].T @ first, curves[BEFORE:].T @ last
        squares = (first**2).sum(axis=0)[:, None] + (last**2).sum(axis=0)
        return np.asarray(squares - ((one[:, :, None] + other[:, None, :]) ** 2).sum(axis=0))

    def _swapped(self, window: Array, plain: Array, stepped: Array) -> Pairs:
        """Return the pairs that are exchanged, if any are: each signal of a pair must show it, the weaker evidence
        counts; and it must be likelier than a blow."""
        left, blow = self._crossed(window), self._blow(plain, stepped)
        crossed = self._misfit(left, np.maximum(self._noise[:, None], self._noise))
        better = np.diagonal(crossed)[:, None] - crossed  # (P, P): if the last readings are those of another
        ratio = [sum(2.0 * min(better[a, b], better[b, a]) for a, b in pairs) for pairs in self.exchanges]
        most = int(np.argmax(ratio)) if ratio else 0
        if not ratio or ratio[most] <= self.least:
            return ()
        pairs = self.exchanges[most]
        likely = -float(plain.sum())
        likely += sum(float(plain[a] + plain[b] - crossed[a, b] - crossed[b, a]) for a, b in pairs)
        return pairs if likely > blow else ()


def _exchanges(machine: Machine) -> list[Pairs]:
    places = {(s.index, s.kind): p for p, s in enumerate(machine.signals[k] for k in pressures(machine))}
    both = [c for c in range(len(machine.cylinders)) if {(c, k) for k in SIDES} <= set(places)]
    sides: list[Pairs] = [((places[c, SIDES[0]], places[c, SIDES[1]]),) for c in both]
    nodes: list[Pairs] = [
        tuple((places[c, k], places[d, k]) for k in SIDES) for i, c in enumerate(both) for d in both[:i]
    ]
    return sides + nodes


def _curves() -> Array:
    """Return curves (W, DEGREE + 1) and, last, a step, orthonormal."""
    t = np.arange(BEFORE + AFTER) - (BEFORE + AFTER - 1) / 2.0
    powers = [t**k for k in range(DEGREE + 1)]
    found, _ = np.linalg.qr(np.stack([*powers, t > BEFORE - (BEFORE + AFTER) / 2.0 - 0.5], axis=1))
    return np.ascontiguousarray(found)


class LeapConstants(Constants):
    """What the leaps of one machine's pressures need.

    test:      comparison of curves
    blocks:    seconds of motion
    reversals: friction that turns round
    settled:   steps after a leap from which on a block is of the time after it
    """

    def __init__(self, machine: MonitoredMachine) -> None:
        model, self.blocks = machine.model, machine.blocks
        self.test = LeapTest(model.machine, model.filters.rate_hz)
        self.reversals = ReversalConstants(model, machine.tares, AFTER * self.test.every)
        self.settled = EVERY * SAMPLES + model.settle_steps
        self.pick = picker(model.machine)

    def error_of(self, doubt: SensorDoubt) -> tuple[int, float]:
        """Return the signal of the blocks that is off, and by how much [bar on the head side]."""
        machine = self.blocks.model.machine
        signal = machine.signals[doubt.signals[0]]
        cylinder = machine.cylinders[signal.index]
        side = 1.0 if signal.kind is Kind.HEAD_PRESSURE else -cylinder.area_rod / cylinder.area_head
        return self.blocks.pressed.index(signal.index), side * doubt.size / BAR


@dataclass(slots=True)
class PressureLeap(Detector):
    """Pressures that leapt, or came back from outside their range.

    constants: of the machine
    reversals: of the cylinders
    readings:  the last ones (T, P), one after the other [Pa]
    before:    readings before those, which are needed seldom
    steps:     of the filters at the last reading
    arrivals:  (P,) times of the frames that the last reading is of [us]; empty: not known
    late:      bit k is set if the reading k readings ago was late or is missing
    since:     steps of the filters when the suspected leap was found
    votes:     of seconds in the air since then against it
    seconds:   of motion since then
    in_air:    number of these that a load explains
    """

    constants: LeapConstants
    reversals: Reversals
    readings: Numbers
    before: Numbers
    steps: int
    arrivals: Numbers
    late: int
    since: int
    votes: float
    seconds: int
    in_air: int
    doubt: SensorDoubt = NOTHING_SUSPECTED

    DESCRIPTION: ClassVar[Description] = Description(
        faults=(SensorFault.SWAPPED, SensorFault.STEPPED, SensorFault.STRAYED),
        looks_at="the last 0.15 s of all pressures; a pressure that was outside its range for more than 0.2 s",
        residual="log likelihood ratio of a curve with a step, or of exchanged curves, to curves that go on",
        threshold="some 17.6: exceeded once in ten hours (Markov's inequality); and likelier than a blow",
        levels="suspected after 50 ms, also in the ground; a strayed pressure at once",
        recovery="seconds in the air that are explained better without the step (Wald, 1 %), or four by a load",
    )

    @classmethod
    def start(cls, machine: MonitoredMachine) -> Self:
        """Return the state before any reading."""
        constants, empty = machine.constants(LeapConstants), array("d")
        return cls(
            constants,
            reversals=Reversals.start(constants.reversals),
            readings=empty,
            before=empty,
            steps=0,
            arrivals=empty,
            late=0,
            since=0,
            votes=0.0,
            seconds=0,
            in_air=0,
        )

    def interrupt(self, why: Interruption) -> None:
        """Forget the readings: the filters begin anew. Suspect pressures that were outside their range, unless another
        leap is suspected already."""
        self._forget_readings()
        self.steps = self.since = 0
        self.reversals.clear()
        strayed = tuple(k for k in why.strayed if k in self.constants.test.signals)
        if strayed and self.doubt.level is Level.FINE:
            self._suspect(SensorDoubt(Level.DOUBTED, SensorFault.STRAYED, strayed))

    def _forget_readings(self) -> None:
        self.readings, self.before, self.arrivals, self.late = array("d"), array("d"), array("d"), 0

    def _suspect(self, doubt: SensorDoubt) -> None:
        self.doubt, self.votes, self.seconds, self.in_air = doubt, 0.0, 0, 0

    def on_step(self, features: Features) -> None:
        """Take the pressures of a step; a step that friction explains is none."""
        now, steps = features.now, features.now.pipeline.steps
        self.reversals.update(now.instant, steps)
        known, since, votes = self.doubt, self.since, self.votes
        arrivals = self.constants.pick(now.arrivals) if now.arrivals else array("d")
        self.take(features.groups.now, steps, arrivals)
        if self.doubt is known or self.doubt.cause is not SensorFault.STEPPED:
            return
        if self.reversals.explains(self.doubt, steps, now.instant.speed, now.values, now.drift):
            self.doubt, self.since, self.votes = known, since, votes

    def take(self, now: Numbers, steps: int, arrivals: Numbers) -> None:
        """Take the pressures (P,) `now` [Pa], at so many `steps` of the filters. A few readings that are missing are
        filled by linear interpolation.

        No leap is concluded beside a reading that is late or missing: what comes after it is of a later time than it
        seems, and differs by what the pressure has changed meanwhile.

        arrivals: (P,) times of the frames that `now` is of [us]; empty: not known
        """
        every = self.constants.test.every
        if steps % every or not now:
            return
        missing = (steps - self.steps) // every - 1
        if missing or not self.readings:
            self._fill(now, missing)
        late = any(a == b for a, b in zip(arrivals, self.arrivals, strict=False))
        self.arrivals = arrivals
        self._read(now, steps, late=late)

    def _fill(self, now: Numbers, missing: int) -> None:
        """Put readings in place of some that are missing; after too many begin anew."""
        if not 0 <= missing <= AFTER or not self.readings:
            self._forget_readings()
            return
        before = self.readings[-len(now) :]
        for k in range(1, missing + 1):
            between = array("d", [a + (b - a) * k / (missing + 1) for a, b in zip(before, now, strict=True)])
            self._read(between, self.steps + self.constants.test.every, late=True)

    def _read(self, now: Numbers, steps: int, *, late: bool) -> None:
        """Take one reading (P,) [Pa], and test whether a leap lies AFTER readings before it."""
        size, test = len(now), self.constants.test
        self.readings += now
        self.steps = steps
        self.late = (self.late << 1 | late) & RECENT
        if len(self.readings) == 2 * WINDOW * size:
            self.before = (self.before + self.readings[: WINDOW * size])[-KEPT * size :]
            self.readings = self.readings[WINDOW * size :]
        last = len(self.readings) // size - AFTER
        # one late reading that is farther away bends no curve
        sound = not self.late & BESIDE and self.late.bit_count() <= 1
        if last < BEFORE or not sound or not test.kernel.suspicious(size, self.readings, last, test.gate):
            return
        doubt = test.leap(np.frombuffer((self.before + self.readings)[-LONGEST * size :]).reshape(-1, size))
        if doubt.level is not Level.FINE:
            self._suspect(doubt)
            self.since = steps

    def on_sample(self, features: Features) -> None:
        """Let a second of motion vote on the leap."""
        if features.blocks.block is not None:
            self.vote(features.blocks.block)

    def vote(self, block: Block) -> None:
        """Take a second of motion."""
        c, rated = self.constants, self.constants.blocks.rated
        if self.doubt.level is Level.FINE or self.steps - self.since <= c.settled:
            return
        stepped, explained = self.doubt.cause is SensorFault.STEPPED, block.explained(rated)
        if stepped:
            x = np.zeros(c.blocks.size)
            signal, x[signal] = c.error_of(self.doubt)
            better = float(cost(block, x, rated)[signal] - cost(block, 0.0, rated)[signal])
            votes = self.votes + min(max(better, -MOST), MOST)
        else:
            votes = self.votes + MOST if explained else 0.0
        self.seconds += 1
        self.in_air += explained
        unconfirmed = stepped and self.seconds >= KEPT_SECONDS and self.in_air >= VOTES and votes > -ENOUGH
        if votes >= ENOUGH or unconfirmed:
            self._suspect(NOTHING_SUSPECTED)
        else:
            self.votes = max(votes, -ENOUGH)
