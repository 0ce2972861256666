"""Detector of pressures that step, or that are swapped, within one reading.

In contact any force is possible, so that a wrong pressure contradicts no other signal until the next motion in the air.
But its onset is detectable. Within 0.15 s healthy pressures follow a curve, or a blow changes all of them. A swapped,
dead or shifted pressure steps alone, between two messages.

Curves (polynomials) through the last readings are compared. Two signals are swapped if curves through the first
readings of one and the last readings of the other have a smaller residual. One signal has stepped if a curve with a
step has a smaller residual. The measure is the log likelihood ratio, with the noise of the residual, but at least the
sensor's. Either must also be more probable than a blow, by which every pressure may step or have any reading.

A step shows *when* a signal may have become wrong, but does not prove *that* it did. The next seconds in the air
decide, in which one load must explain the torques of all joints. A step is confirmed if the load explains them better
without it. With swapped signals a load hardly ever explains the torques, so that some seconds in a row that a load
explains end the suspicion. A step that is not confirmed ends by itself after as many seconds of motion as
`constant_error` keeps, some of them in the air: no older evidence exists then."""

from array import array
from dataclasses import dataclass
from math import exp, inf, log, pi, sqrt
from typing import Self

import numpy as np

from cylforce.estimation.kernel import choice
from cylforce.estimation.kernel.functions import Kernel
from cylforce.estimation.kernel.making import counts, numbers
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solving import ZERO
from cylforce.mechanics.machine import Machine
from cylforce.service.plausibility.blocks import BAR, EVERY, SAMPLES, Block, cost
from cylforce.service.plausibility.detector import Detector, Features, Interruption, MonitoredMachine
from cylforce.service.plausibility.detectors.constant_error import KEPT as KEPT_SECONDS
from cylforce.service.plausibility.detectors.constant_error import VOTES
from cylforce.service.plausibility.pressure_groups import picker, pressures
from cylforce.service.plausibility.reversals import ReversalConstants, Reversals
from cylforce.service.plausibility.suspicion import NOTHING_SUSPECTED, Level, SensorFault, SensorSuspicion
from cylforce.service.snapshot import Constants
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import SIDES, Kind

# Readings before and after a step, and the degree of the curves. Chosen on foreign machines 1 to 5 (tools/faulting)
BEFORE, AFTER, DEGREE = 10, 5, 3
FREE = BEFORE + AFTER - DEGREE - 2  # degrees of freedom of the residual of a curve with a step
# Pieces of WINDOW readings from which the earlier noise is estimated, and the degrees of freedom of that estimate
# (Student's t): it counts as much as the present residual. Chosen on foreign machines: noise changes every second
PIECES, KNOWN = 6, FREE
WINDOW = BEFORE + AFTER
# Bits of `late`: all that are kept; the last two readings before a step and the first one after it. Frames that have
# waited arrive together, and a tick may read only some of them: the reading after a late one may be old, too.
RECENT, BESIDE = (1 << WINDOW) - 1, 0b111 << (AFTER - 1)
KEPT = PIECES * WINDOW
LONGEST = KEPT + WINDOW
# Log likelihood ratio of a step or swap: healthy signals exceed it once in ten hours, if each instant is tested for
# each step and each swap (Markov's inequality: the ratio's mean is one)
HOURS = 10.0
RESOLVED = 100.0  # Pa: less is not resolved by any such sensor; 0.00025 % of 400 bar

WRONGLY = 0.01  # probability with which the suspicion of a real fault ends (Wald's sequential test); by convention
ENOUGH = -2.0 * log(WRONGLY)  # sum of votes, twice the log likelihood ratio, that ends a suspicion
MOST = ENOUGH / VOTES  # largest vote of one second: at least VOTES of them must agree

Pairs = tuple[tuple[int, int], ...]


class StepTest:
    """Comparison of curves through the readings of one machine's pressures.

    kernel:     compiled or interpreted functions
    signals:    (P,) numbers of the pressures
    swaps:      possible swaps as pairs of pressure numbers: both sides of a cylinder; the nodes of two cylinders
    pairs:      pairs of all swaps one after the other, as the kernel takes them; -1 where a swap has fewer
    most_pairs: largest number of pairs of a swap
    every:      steps between two readings, so many that the slowest signal is sent anew for each reading
    least:      log likelihood ratio [nats] above which a step is suspected; infinite for a machine without pressures
    gate:       (P,) change between two readings below which nothing is tested, see `_gate` [Pa]
    curves:     (WINDOW, DEGREE+2) orthonormal polynomials up to DEGREE, then a step
    """

    def __init__(self, machine: Machine, rate_hz: float, kernel: Kernel | None = None) -> None:
        """Compute the curves, the possible swaps, and the log likelihood ratio of one false alarm in HOURS.

        machine: whose pressures are tested, with their standard errors and ranges
        rate_hz: steps per second [Hz]
        kernel:  form of the kernel; None: the compiled one if there is one
        """
        self.kernel, self.signals = kernel or choice.chosen(), pressures(machine)
        own = [machine.signals[k] for k in self.signals]
        self.swaps = _swaps(machine)
        self.every = max(1, round(max((s.period_s for s in own), default=0.0) * rate_hz))
        tests = 3600.0 * HOURS * rate_hz * (len(own) + len(self.swaps))
        self.least = log(tests) if tests else inf
        self._noise = np.array([max(s.standard_error, RESOLVED) ** 2 for s in own])  # variance (P,) [Pa^2]
        self.curves = _curves()
        self._rise = float(self.curves[BEFORE:, -1].sum())  # product of a step of 1 with the orthonormal step
        widths = np.log(np.array([s.high - s.low for s in own]) / np.sqrt(2.0 * pi * self._noise))
        # Occam factors (P,) [nats], width of the prior over that of the posterior: a step may have any size within the
        # sensor's range, either way; all readings after a blow may have any value
        self._any_step = widths + log(2.0 * abs(self._rise))
        self._anything = AFTER * (widths - 0.5)
        self.gate = self._gate()
        self.most_pairs = max(map(len, self.swaps), default=0)
        filled = [(*pairs, *[(-1, -1)] * (self.most_pairs - len(pairs))) for pairs in self.swaps]
        self.pairs = counts(p for pairs in filled for pair in pairs for p in pair)

    def _gate(self) -> Numbers:
        """Return the change (P,) [Pa] between two readings below which no step can be suspected.

        A step of s sensor noises (standard deviations) adds (s rise)^2 to the sum of squares of the residual, in units
        of the noise variance; `rise` is the product of a step of 1 with the orthonormal step. Let L = `least`.

        A swap needs the ratio L / 2 of each of its two signals, without noise of earlier readings
        (`_minus_log_likelihood_alone`): FREE / 2 log(1 + (s rise)^2 / FREE) = L / 2. A step of one signal needs L, at
        best with a known noise (Student's t, `_minus_log_likelihood`): n / 2 log(1 + (s rise)^2 / n) = L, with
        n = FREE + KNOWN.

        The gate is half of the smaller s; chosen, as room for noise and motion that act against the step.
        """
        n = FREE + KNOWN
        of_swap = FREE * (exp(self.least / FREE) - 1.0)
        of_one = n * (exp(2.0 * self.least / n) - 1.0)
        return numbers(0.5 * (sqrt(min(of_swap, of_one)) / abs(self._rise)) * np.sqrt(self._noise))

    def suspicion(self, readings: Array) -> SensorSuspicion:
        """Return the suspicion of pressures that stepped or were swapped just before the last AFTER readings.

        The kernel tests quickly whether a step or swap is possible; only then the exact tests follow, `_swapped` first.

        readings: (T, P) [Pa], T at least WINDOW. A step is sought in the last WINDOW of them, between BEFORE and AFTER
                  readings. If T = LONGEST, the earlier ones give the noise.
        """
        window = np.ascontiguousarray(readings[-WINDOW:])
        size, smooth = window.shape[1], DEGREE + 1  # P; number of curves without the step
        limits = (self.curves, smooth, self._noise, float(FREE), float(KNOWN), self.least)
        swaps = (self.pairs, len(self.swaps), self.most_pairs)
        # written by the kernel: (P, 2, smooth + 2) products of readings and curves, which are not used here; (2, P)
        # minus the log likelihoods [nats] of curves without and with a step
        products, minus_logs = ZERO * (2 * size * (smooth + 2)), ZERO * (2 * size)
        # bit 0: a step is possible, bit 1: a swap is
        possible = self.kernel.possible_steps(size, window, len(window), BEFORE, *limits, *swaps, products, minus_logs)
        swapped = self._swapped(window, *np.frombuffer(minus_logs).reshape(2, size)) if possible & 2 else ()
        if swapped:
            signals = tuple(sorted(self.signals[p] for pair in swapped for p in pair))
            return SensorSuspicion(Level.SUSPECTED, SensorFault.SWAPPED, signals)
        return self._stepped(window, readings[:-WINDOW]) if possible & 1 else NOTHING_SUSPECTED

    def _stepped(self, window: Array, earlier: Array) -> SensorSuspicion:
        """Return the suspicion of the pressure that stepped alone; NOTHING_SUSPECTED if none did.

        A smooth curve with a step after BEFORE readings must explain it much better than one without the step, and
        better than a blow to all pressures. The step is the last of the orthonormal `curves`.

        window:  (WINDOW, P) last readings [Pa]
        earlier: (T, P) readings before them [Pa]
        """
        along = self.curves.T @ (window - window[0])
        squared = ((window - window[0]) ** 2).sum(axis=0) - (along**2).sum(axis=0)
        variance = self._noise_before(earlier)
        plain = self._minus_log_likelihood(squared + along[-1] ** 2, variance)
        stepped = self._minus_log_likelihood(squared, variance)
        most = int(np.argmax(plain - stepped))
        alone = -float(plain.sum() - plain[most] + stepped[most] + self._any_step[most])
        if plain[most] - stepped[most] <= self.least or alone <= self._blow(plain, stepped):
            return NOTHING_SUSPECTED
        size = float(along[-1, most] / self._rise)  # [Pa]
        return SensorSuspicion(Level.SUSPECTED, SensorFault.STEPPED, (self.signals[most],), size)

    def _noise_before(self, earlier: Array) -> Array | None:
        """Return the noise variance (P,) [Pa^2] of each pressure before the window; None for fewer than KEPT readings.

        The KEPT readings are cut into PIECES pieces of WINDOW readings. A polynomial of degree DEGREE is fitted to each
        piece: all columns of `curves`, which are orthonormal, except the step, the last one. The variance is the sum of
        squares of the residual over its degrees of freedom, FREE + 1 as no step is fitted, in the mean over the pieces.
        It is at least the sensor's own.

        earlier: (T, P) readings before the window [Pa], at most KEPT of them
        """
        if len(earlier) < KEPT:
            return None
        pieces = earlier.reshape(PIECES, WINDOW, -1) - earlier.reshape(PIECES, WINDOW, -1)[:, :1]
        squared = (pieces**2).sum(axis=1) - ((self.curves[:, :-1].T @ pieces) ** 2).sum(axis=1)
        return np.asarray(np.maximum(squared.mean(axis=0) / (FREE + 1), self._noise))

    def _minus_log_likelihood(self, squared: Array, variance: Array | None) -> Array:
        """Return minus the log likelihood (P,) [nats] of the residual of a curve through the window of each pressure.

        It is relative to the likelihood at the expected sum of squares, FREE times the variance; a smaller residual has
        0 as well. With a variance from earlier readings the distribution is Student's: that variance has KNOWN degrees
        of freedom, the residual FREE. Without it the residual's own variance is used (`_minus_log_likelihood_alone`).

        squared:  (P,) sum of squares of the residual [Pa^2]
        variance: (P,) of the noise of the earlier readings [Pa^2] (`_noise_before`); None: not known
        """
        if variance is None:
            return self._minus_log_likelihood_alone(squared, self._noise)
        ratio = (KNOWN + squared / variance) / (KNOWN + FREE)  # 1 at the expected sum of squares
        return np.asarray(0.5 * (FREE + KNOWN) * np.log(np.maximum(ratio, 1.0)))

    def _blow(self, plain: Array, stepped: Array) -> float:
        """Return the log likelihood [nats] of a blow to the machine, which changes all pressures at once.

        Each pressure continues, steps, or has any readings, with equal probability.

        plain:   (P,) minus the log likelihoods of curves without a step
        stepped: (P,) minus the log likelihoods of curves with a step
        """
        either = np.logaddexp(np.logaddexp(-plain, -stepped - self._any_step), -self._anything)
        return float(np.sum(either - log(3.0)))

    def _minus_log_likelihood_alone(self, squared: Array, noise: Array) -> Array:
        """Return minus the log likelihood [nats] of a curve's residual, with the variance of this residual itself.

        The variance is the sum of squares over its FREE degrees of freedom, at least `noise`. The result is relative to
        the likelihood at `noise`, and 0 for any smaller residual.

        squared: sums of squares of the residuals, of any shape [Pa^2]
        noise:   least variance of each [Pa^2], with the shape of `squared`
        """
        return np.asarray(0.5 * FREE * np.log(np.maximum(squared / (FREE * noise), 1.0)))

    def _crossed(self, window: Array) -> Array:
        """Return the squared residuals (P, P) [Pa^2] of smooth curves through the readings of two pressures each.

        Element (a, b) is that of a curve through the first readings of a and the last readings of b: small if the plugs
        of a and b were swapped.

        window: (WINDOW, P) last readings [Pa]
        """
        curves, first, last = self.curves[:, :-1], window[:BEFORE], window[BEFORE:]
        one, other = curves[:BEFORE].T @ first, curves[BEFORE:].T @ last
        squares = (first**2).sum(axis=0)[:, None] + (last**2).sum(axis=0)
        return np.asarray(squares - ((one[:, :, None] + other[:, None, :]) ** 2).sum(axis=0))

    def _swapped(self, window: Array, plain: Array, stepped: Array) -> Pairs:
        """Return the pairs of pressures that were swapped; empty if none were.

        Curves through the first readings of one and the last readings of the other must explain them much better than
        curves through the readings of each. Both signals of a pair must be evidence, and the weaker evidence counts
        twice. A swap must be likelier than a blow.

        window:  (WINDOW, P) last readings [Pa]
        plain:   (P,) minus the log likelihoods [nats] of curves without a step
        stepped: (P,) minus the log likelihoods [nats] of curves with a step
        """
        squared, blow = self._crossed(window), self._blow(plain, stepped)
        crossed = self._minus_log_likelihood_alone(squared, np.maximum(self._noise[:, None], self._noise))
        better = np.diagonal(crossed)[:, None] - crossed  # (P, P): if the last readings are those of another
        ratio = [sum(2.0 * min(better[a, b], better[b, a]) for a, b in pairs) for pairs in self.swaps]
        most = int(np.argmax(ratio)) if ratio else 0
        if not ratio or ratio[most] <= self.least:
            return ()
        pairs = self.swaps[most]
        likely = -float(plain.sum())
        likely += sum(float(plain[a] + plain[b] - crossed[a, b] - crossed[b, a]) for a, b in pairs)
        return pairs if likely > blow else ()


def _swaps(machine: Machine) -> list[Pairs]:
    """Return the possible swaps of a machine's pressures, each as pairs of their numbers among the P pressures.

    A plug may be exchanged between both sides of a cylinder, or a node of both sides between two cylinders."""
    places = {(s.index, s.kind): p for p, s in enumerate(machine.signals[k] for k in pressures(machine))}
    both = [c for c in range(len(machine.cylinders)) if {(c, k) for k in SIDES} <= set(places)]
    sides: list[Pairs] = [((places[c, SIDES[0]], places[c, SIDES[1]]),) for c in both]
    nodes: list[Pairs] = [
        tuple((places[c, k], places[d, k]) for k in SIDES) for i, c in enumerate(both) for d in both[:i]
    ]
    return sides + nodes


def _curves() -> Array:
    """Return the curves that are fitted to a window of readings, as orthonormal columns (WINDOW, DEGREE + 2).

    They are polynomials of the time up to DEGREE, then a step after BEFORE readings."""
    t = np.arange(BEFORE + AFTER) - (BEFORE + AFTER - 1) / 2.0
    powers = [t**k for k in range(DEGREE + 1)]
    found, _ = np.linalg.qr(np.stack([*powers, t > BEFORE - (BEFORE + AFTER) / 2.0 - 0.5], axis=1))
    return np.ascontiguousarray(found)


class StepConstants(Constants):
    """Constants of the steps of one machine's pressures.

    test:      comparison of curves
    blocks:    constants of the seconds of motion
    reversals: constants of the friction that reverses
    settled:   number of steps after which a block contains only samples from after the step
    pick:      function that selects the pressures (P,) of all signals (S,)
    """

    def __init__(self, machine: MonitoredMachine) -> None:
        """Compute the constants of the test, and of the motion that confirms or refutes a step.

        machine: constants of the machine
        """
        model, self.blocks = machine.model, machine.blocks
        self.test = StepTest(model.machine, model.filters.rate_hz)
        self.reversals = ReversalConstants(model, machine.tares, AFTER * self.test.every)
        self.settled = EVERY * SAMPLES + model.settle_steps
        self.pick = picker(model.machine)

    def error_of(self, suspicion: SensorSuspicion) -> tuple[int, float]:
        """Return the suspected cylinder force as a number in the blocks, and its error [bar on the head side].

        suspicion: of one pressure that stepped by `size` [Pa]; a rod pressure counts by the ratio of the areas, with
                   the sign reversed
        """
        machine = self.blocks.model.machine
        signal = machine.signals[suspicion.signals[0]]
        cylinder = machine.cylinders[signal.index]
        side = 1.0 if signal.kind is Kind.HEAD_PRESSURE else -cylinder.area_rod / cylinder.area_head
        return self.blocks.pressed.index(signal.index), side * suspicion.size / BAR


@dataclass(slots=True)
class PressureStep(Detector):
    """Pressures that stepped, were swapped, or returned from outside their range.

    constants: of the machine
    reversals: of the cylinders
    readings:  the last readings (T, P), flat [Pa]
    before:    readings before `readings`, which are seldom used [Pa]
    steps:     step of the filters at the last reading
    arrivals:  (P,) receive times of the frames that carried the last reading [us]; empty: not known
    late:      bit k is set if the reading k readings ago was late or is missing
    since:     step of the filters at which the suspected step was found
    votes:     sum of the votes against the suspicion since then, twice the log likelihood ratio
    seconds:   number of seconds of motion since then
    in_air:    number of these seconds that a load explains
    report:    present suspicion
    """

    constants: StepConstants
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
    report: SensorSuspicion = NOTHING_SUSPECTED

    @classmethod
    def start(cls, machine: MonitoredMachine) -> Self:
        """Return the detector before any reading: no pressure is suspected to have stepped."""
        constants, empty = machine.constants(StepConstants), array("d")
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
        """Discard the readings, because the filters begin anew after an interruption.

        Pressures that were outside their range are suspected, unless there is a suspicion already.

        why: cause of the interruption, with the numbers of the signals outside their range
        """
        self._forget_readings()
        self.steps = self.since = 0
        self.reversals.clear()
        out_of_range = tuple(k for k in why.out_of_range if k in self.constants.test.signals)
        if out_of_range and self.report.level is Level.FINE:
            self._suspect(SensorSuspicion(Level.SUSPECTED, SensorFault.BACK_IN_RANGE, out_of_range))

    def _forget_readings(self) -> None:
        """Discard all readings with their receive times, so that the next reading begins a new series."""
        self.readings, self.before, self.arrivals, self.late = array("d"), array("d"), array("d"), 0

    def _suspect(self, suspicion: SensorSuspicion) -> None:
        """Report a suspicion, or NOTHING_SUSPECTED, and begin the votes against it anew."""
        self.report, self.votes, self.seconds, self.in_air = suspicion, 0.0, 0, 0

    def on_step(self, features: Features) -> None:
        """Update the suspicion with the pressures of a step; discard a new one that a reversal of friction explains."""
        now, steps = features.now, features.now.pipeline.steps
        self.reversals.update(now.instant, steps)
        known, since, votes = self.report, self.since, self.votes
        arrivals = self.constants.pick(now.arrivals) if now.arrivals else array("d")
        self.take(features.groups.now, steps, arrivals)
        if self.report is known or self.report.cause is not SensorFault.STEPPED:
            return
        if self.reversals.explains(self.report, steps, now.instant.speed, now.values, now.drift):
            self.report, self.since, self.votes = known, since, votes

    def take(self, now: Numbers, steps: int, arrivals: Numbers) -> None:
        """Update the suspicion with the pressures of a step, if a reading is due at it.

        A few missing readings are linearly interpolated. A reading is late if one of its values is from the same frame
        as in the reading before.

        Beside a late or missing reading no step is concluded: the pressure has changed meanwhile by more than the
        readings' nominal interval explains.

        now:      (P,) pressures [Pa]
        steps:    number of steps of the filters
        arrivals: (P,) receive times of the frames that carried `now` [us]; empty: not known
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
        """Insert linearly interpolated readings for `missing` ones; discard all readings if too many are missing.

        now: (P,) present pressures [Pa], up to which the readings are interpolated
        """
        if not 0 <= missing <= AFTER or not self.readings:
            self._forget_readings()
            return
        before = self.readings[-len(now) :]
        for k in range(1, missing + 1):
            between = array("d", [a + (b - a) * k / (missing + 1) for a, b in zip(before, now, strict=True)])
            self._read(between, self.steps + self.constants.test.every, late=True)

    def _read(self, now: Numbers, steps: int, *, late: bool) -> None:
        """Append one reading, and test for a step or swap just before the last AFTER readings, this one among them.

        Nothing is tested beside a late reading, or where no pressure changed by more than the gate.

        now:   (P,) pressures [Pa]
        steps: number of steps of the filters
        late:  whether the reading is late or interpolated
        """
        size, test = len(now), self.constants.test
        self.readings += now
        self.steps = steps
        self.late = (self.late << 1 | late) & RECENT
        if len(self.readings) == 2 * WINDOW * size:
            self.before = (self.before + self.readings[: WINDOW * size])[-KEPT * size :]
            self.readings = self.readings[WINDOW * size :]
        last = len(self.readings) // size - AFTER
        # one late reading farther away hardly changes a curve
        sound = not self.late & BESIDE and self.late.bit_count() <= 1
        if last < BEFORE or not sound or not test.kernel.may_step(size, self.readings, last, test.gate):
            return
        suspicion = test.suspicion(np.frombuffer((self.before + self.readings)[-LONGEST * size :]).reshape(-1, size))
        if suspicion.level is not Level.FINE:
            self._suspect(suspicion)
            self.since = steps

    def on_sample(self, features: Features) -> None:
        """Update the votes with a second of motion that has ended."""
        if features.blocks.block is not None:
            self.vote(features.blocks.block)

    def vote(self, block: Block) -> None:
        """Update the votes against the suspicion with a second of motion, and end the suspicion with enough of them.

        A second votes against a suspected step by twice the log likelihood ratio without and with that step, at most
        MOST either way. A second that a load explains votes against any other suspicion (swap, return into the range)
        by MOST; one that no load explains resets the votes. A step that is not confirmed ends after KEPT_SECONDS
        seconds of motion, at least VOTES of them in the air. Seconds with samples from before the step have no vote.

        block: evidence of the second about the errors of the signals
        """
        c, rated = self.constants, self.constants.blocks.rated
        if self.report.level is Level.FINE or self.steps - self.since <= c.settled:
            return
        stepped, explained = self.report.cause is SensorFault.STEPPED, block.explained(rated)
        if stepped:
            x = np.zeros(c.blocks.size)
            signal, x[signal] = c.error_of(self.report)
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
