"""Has a pressure leapt as no oil does? In contact any force is possible, so that a pressure that is wrong contradicts
nothing until the next motion in the air. But the moment shows in which it becomes wrong. Within 0.15 s pressures follow
a curve, or all of them are hit; one that is exchanged, dead or shifted leaps by itself, between two messages.

Curves (polynomials) through the last readings are compared. Two signals are exchanged if each goes on where the other
one was: curves through the first readings of one and the last ones of the other leave less. One signal steps if a curve
with a step leaves less. By how much: the log likelihood ratio, with the noise that is left, but at least the
sensor's. Either must also be more probable than a blow, by which every pressure may step or do anything."""

from array import array
from dataclasses import dataclass, field
from math import exp, log, pi, sqrt
from typing import Any, NamedTuple

import numpy as np

from cylforce.estimation.kernel import choice
from cylforce.estimation.kernel.making import counts, numbers
from cylforce.estimation.kernel.restricted import Counts, Numbers
from cylforce.estimation.kernel.solving import ZERO
from cylforce.mechanics.machine import Machine
from cylforce.service.plausibility.changing import NONE, pressures
from cylforce.service.plausibility.suspicion import NOTHING_SUSPECTED, Level, SensorDoubt, SensorFault
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import SIDES
from cylforce.signals.quick import new, once

# Readings before and after a leap, and the degree of the curves. Chosen on foreign machines 1 to 5 (tools/faulting)
BEFORE, AFTER, DEGREE = 10, 5, 3
FREE = BEFORE + AFTER - DEGREE - 2  # degrees of freedom of what a curve with a step leaves
# Readings, in pieces as long as these, from which the noise before is known; what they leave counts as much as what is
# left now (degrees of freedom of Student's t). Chosen on the same: noise changes from second to second
PIECES, KNOWN = 6, FREE
WINDOW = BEFORE + AFTER
# Bits of `Leaps.late`: all that are kept; the last two readings before a leap and the first one after it. Of frames
# that waited and come together a tick may find some: the reading after a late one may be old, too.
RECENT, BESIDE = (1 << WINDOW) - 1, 0b111 << (AFTER - 1)
KEPT = PIECES * WINDOW
LONGEST = KEPT + WINDOW
# Log likelihood ratio of a leap: an order of signals that is right exceeds it once in ten hours, if each of its
# moments is tested for each leap (Markov's inequality: the ratio's mean is one)
HOURS = 10.0
RESOLVED = 100.0  # Pa: less is not resolved by any such sensor; 0.00025 % of 400 bar

Pairs = tuple[tuple[int, int], ...]


class Leaps(NamedTuple):
    """State, of P pressures: the last `readings` (T, P) [Pa], one after the other; `steps` of the filters at the last
    one; the leap that is doubted, the steps `since` which it is, and what seconds in the air said against it
    (`votes`); readings `before` those, which are asked seldom.

    came: (P,) times [us] of the frames that the last reading is of
    late: bit k is set if the reading k readings ago was late or is missing
    seconds, in_air: seconds of motion since the leap that is doubted, and those of them that a load explains"""

    readings: Numbers = NONE
    steps: int = 0
    doubt: SensorDoubt = NOTHING_SUSPECTED
    since: int = 0
    votes: float = 0.0
    before: Numbers = NONE
    came: Numbers = NONE
    late: int = 0
    seconds: int = 0
    in_air: int = 0


@dataclass(frozen=True)
class Leaping:
    """The pressures of one machine, read `rate_hz` times a second."""

    machine: Machine
    rate_hz: float
    kernel: Any = field(default_factory=lambda: choice.chosen())  # noqa: PLW0108 - asked when it is made

    @once
    def signals(self) -> list[int]:
        """Numbers (P,) of the signals."""
        return pressures(self.machine)

    @once
    def exchanges(self) -> list[Pairs]:
        """What may be exchanged, as numbers of pressures: the sides of a cylinder; two cylinders' nodes."""
        places = {(s.index, s.kind): p for p, s in enumerate(self.machine.signals[k] for k in self.signals)}
        both = [c for c in range(len(self.machine.cylinders)) if {(c, k) for k in SIDES} <= set(places)]
        sides: list[Pairs] = [((places[c, SIDES[0]], places[c, SIDES[1]]),) for c in both]
        nodes: list[Pairs] = [
            tuple((places[c, k], places[d, k]) for k in SIDES) for i, c in enumerate(both) for d in both[:i]
        ]
        return sides + nodes

    @once
    def least(self) -> float:
        """Log likelihood ratio from which on a leap is doubted."""
        tests = 3600.0 * HOURS * self.rate_hz * (len(self.signals) + len(self.exchanges))
        return log(tests)

    @once
    def _every(self) -> int:
        """Steps between two readings: no signal is repeated because it is sent less often."""
        periods = (self.machine.signals[k].period_s for k in self.signals)
        return max(1, round(max(periods, default=0.0) * self.rate_hz))

    @property
    def steps_after(self) -> int:
        """Steps between a leap and the reading at which it is doubted."""
        return AFTER * self._every

    @once
    def _noise(self) -> Array:
        """Variance (P,) [Pa^2] of what a sensor says."""
        return np.array([max(self.machine.signals[k].standard_error, RESOLVED) ** 2 for k in self.signals])

    @once
    def _curves(self) -> Array:
        """Curves (W, DEGREE + 1) and, last, a step, orthonormal."""
        t = np.arange(BEFORE + AFTER) - (BEFORE + AFTER - 1) / 2.0
        powers = [t**k for k in range(DEGREE + 1)]
        found, _ = np.linalg.qr(np.stack([*powers, t > BEFORE - (BEFORE + AFTER) / 2.0 - 0.5], axis=1))
        return np.ascontiguousarray(found)

    @once
    def _arbitrary(self) -> Array:
        """What it costs (2, P) [nats] that a step may be of any size that the sensor can show, either way, and that all
        readings after a blow may be anything: widths of the prior over those of what is found (Occam factors)."""
        signals = [self.machine.signals[k] for k in self.signals]
        widths = np.log(np.array([s.high - s.low for s in signals]) / np.sqrt(2.0 * pi * self._noise))
        step = widths + log(2.0 * abs(float(self._curves[BEFORE:, -1].sum())))
        return np.stack([step, AFTER * (widths - 0.5)])

    @once
    def _gate(self) -> Numbers:
        """Change (P,) [Pa] within a reading below which nothing is looked for: half of the least leap that could be
        doubted, that of two signals."""
        many = 2 * (FREE + KNOWN)
        squares = min(FREE * (exp(self.least / FREE) - 1.0), 0.5 * many * (exp(4.0 * self.least / many) - 1.0))
        least = sqrt(squares) / abs(float(self._curves[BEFORE:, -1].sum()))
        return numbers(0.5 * least * np.sqrt(self._noise))

    def begin(self) -> Leaps:
        """Nothing was seen."""
        return Leaps()

    def interrupt(self, state: Leaps) -> Leaps:
        """The measurement stopped, and the filters begin anew: what was read before says nothing of what follows."""
        return state._replace(readings=NONE, before=NONE, steps=0, since=0, came=NONE, late=0)

    def strayed(self, state: Leaps, signals: tuple[int, ...]) -> Leaps:
        """These `signals` were outside their range for so long that the measurement stopped: what a pressure says when
        it is back is doubted as after a leap, unless another leap is doubted already."""
        own = tuple(k for k in signals if k in self.signals)
        if not own or state.doubt.level is not Level.FINE:
            return state
        return state._replace(
            doubt=SensorDoubt(Level.DOUBTED, SensorFault.STRAYED, own), votes=0.0, seconds=0, in_air=0
        )

    def step(self, state: Leaps, now: Numbers, steps: int, came: Numbers = NONE) -> Leaps:
        """Return the state after one step. A few readings that are missing are filled by linear interpolation.

        No leap is concluded beside a reading that is late or missing: what comes after it is of a later time than it
        seems, and differs by what the pressure has changed meanwhile.

        now:   (P,) pressures [Pa]
        steps: of the filters so far
        came:  (P,) times [us] of the frames that `now` is of; empty: not known"""
        every = self._every
        if steps % every or not now:
            return state
        missing = (steps - state.steps) // every - 1
        if missing or not state.readings:
            state = self._filled(state, now, missing)
        late = any(a == b for a, b in zip(came, state.came, strict=False))
        return self._with(state._replace(came=came), now, steps, late=late)

    def _with(self, state: Leaps, now: Numbers, steps: int, *, late: bool) -> Leaps:
        """The state with one more reading (P,) [Pa]."""
        size, readings, before = len(now), state.readings + now, state.before
        if len(readings) == 2 * WINDOW * size:
            before, readings = (before + readings[: WINDOW * size])[-KEPT * size :], readings[WINDOW * size :]
        last, lately = len(readings) // size - AFTER, (state.late << 1 | late) & RECENT
        sound = not lately & BESIDE and lately.bit_count() <= 1  # one that is farther away bends no curve
        looked = last >= BEFORE and sound
        if looked and self.kernel.suspicious(size, readings, last, self._gate):
            doubt = self.leap(np.frombuffer((before + readings)[-LONGEST * size :]).reshape(-1, size))
            if doubt.level is not Level.FINE:
                return Leaps(readings, steps, doubt, steps, before=before, came=state.came, late=lately)
        kept = (readings, steps, state.doubt, state.since, state.votes, before, state.came, lately)
        return new(Leaps, (*kept, state.seconds, state.in_air))

    def _filled(self, state: Leaps, now: Numbers, missing: int) -> Leaps:
        """The state with readings in place of some that are missing; after too many it begins anew."""
        if not 0 <= missing <= AFTER or not state.readings:
            return state._replace(readings=NONE, before=NONE, came=NONE, late=0)
        before, filled = state.readings[-len(now) :], state
        for k in range(1, missing + 1):
            between = array("d", [a + (b - a) * k / (missing + 1) for a, b in zip(before, now, strict=True)])
            filled = self._with(filled, between, filled.steps + self._every, late=True)
        return filled

    def leap(self, readings: Array) -> SensorDoubt:
        """What leapt between the last AFTER `readings` (T, P) [Pa] and the BEFORE that are before them; the others show
        the noise, if there are LONGEST."""
        window = np.ascontiguousarray(readings[-WINDOW:])
        size, bends, (pairs, most) = window.shape[1], DEGREE + 1, self._pairs
        told = (self._curves, bends, self._noise, float(FREE), float(KNOWN), self.least, pairs, len(self.exchanges))
        room, misfit = ZERO * (2 * size * (bends + 2)), ZERO * (2 * size)
        sure = self.kernel.sure_leaps(size, window, len(window), BEFORE, *told, most, room, misfit)
        swapped = self._swapped(window, *np.frombuffer(misfit).reshape(2, size)) if sure > 1 else ()
        if swapped:
            signals = tuple(sorted(self.signals[p] for pair in swapped for p in pair))
            return SensorDoubt(Level.DOUBTED, SensorFault.SWAPPED, signals)
        return self._stepped(window, readings[:-WINDOW]) if sure % 2 else NOTHING_SUSPECTED

    def _stepped(self, window: Array, earlier: Array) -> SensorDoubt:
        """The pressure that stepped alone, if one did."""
        along = self._curves.T @ (window - window[0])
        left = ((window - window[0]) ** 2).sum(axis=0) - (along**2).sum(axis=0)
        known = self._known(earlier)
        plain, stepped = self._unlikely(left + along[-1] ** 2, known), self._unlikely(left, known)
        most = int(np.argmax(plain - stepped))
        alone = -float(plain.sum() - plain[most] + stepped[most] + self._arbitrary[0, most])
        if plain[most] - stepped[most] <= self.least or alone <= self._blow(plain, stepped):
            return NOTHING_SUSPECTED
        size = float(along[-1, most] / self._curves[BEFORE:, -1].sum())
        return SensorDoubt(Level.DOUBTED, SensorFault.STEPPED, (self.signals[most],), size)

    def _known(self, earlier: Array) -> Array | None:
        """Variance (P,) [Pa^2] of what curves left of readings (T, P) before; None of too few."""
        if len(earlier) < KEPT:
            return None
        each = earlier.reshape(PIECES, WINDOW, -1) - earlier.reshape(PIECES, WINDOW, -1)[:, :1]
        left = (each**2).sum(axis=1) - ((self._curves[:, :-1].T @ each) ** 2).sum(axis=1)
        return np.asarray(np.maximum(left.mean(axis=0) / (FREE + 1), self._noise))

    def _unlikely(self, left: Array, known: Array | None) -> Array:
        """Minus the log likelihood [nats] of what is `left` [Pa^2]: if the variance before is `known`, Student's."""
        if known is None:
            return self._misfit(left, self._noise)
        share = (KNOWN + left / known) / (KNOWN + FREE)
        return np.asarray(0.5 * (FREE + KNOWN) * np.log(np.maximum(share, 1.0)))

    @once
    def _pairs(self) -> tuple[Counts, int]:
        """The pairs of each exchange as the kernel takes them, and the most that one has."""
        most = max(map(len, self.exchanges), default=0)
        filled = [(*pairs, *[(-1, -1)] * (most - len(pairs))) for pairs in self.exchanges]
        return counts(p for pairs in filled for pair in pairs for p in pair), most

    def _blow(self, plain: Array, stepped: Array) -> float:
        """Log likelihood [nats] that all pressures are hit: each is as likely to go on, to step, or to do anything."""
        step, anything = self._arbitrary
        return float(np.sum(np.logaddexp(np.logaddexp(-plain, -stepped - step), -anything) - log(3.0)))

    def _misfit(self, left: Array, noise: Array) -> Array:
        """Minus the log likelihood [nats] of what is `left` [Pa^2], of a variance of its own, but at least the `noise`
        [Pa^2]; 0: no more than that."""
        return np.asarray(0.5 * FREE * np.log(np.maximum(left / (FREE * noise), 1.0)))

    def _left(self, window: Array) -> Array:
        """What the curves through the first readings of one pressure and the last ones of another leave, (P, P) [Pa^2],
        in squares."""
        curves, first, last = self._curves[:, :-1], window[:BEFORE], window[BEFORE:]
        one, other = curves[:BEFORE].T @ first, curves[BEFORE:].T @ last
        squares = (first**2).sum(axis=0)[:, None] + (last**2).sum(axis=0)
        return np.asarray(squares - ((one[:, :, None] + other[:, None, :]) ** 2).sum(axis=0))

    def _swapped(self, window: Array, plain: Array, stepped: Array) -> Pairs:
        """The pairs that are exchanged, if any are: each signal of a pair must say so, the one that says less counts;
        and it must be likelier than a blow."""
        left, blow = self._left(window), self._blow(plain, stepped)
        told = self._misfit(left, np.maximum(self._noise[:, None], self._noise))
        better = np.diagonal(told)[:, None] - told  # (P, P): if the last readings are those of another
        ratio = [sum(2.0 * min(better[a, b], better[b, a]) for a, b in pairs) for pairs in self.exchanges]
        most = int(np.argmax(ratio)) if ratio else 0
        if not ratio or ratio[most] <= self.least:
            return ()
        pairs = self.exchanges[most]
        log_of = -float(plain.sum()) + sum(float(plain[a] + plain[b] - told[a, b] - told[b, a]) for a, b in pairs)
        return pairs if log_of > blow else ()
