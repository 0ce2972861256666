"""Guidance through the commissioning of the empty machine: samples in, advice out.

The advice contains missing motion, the next instruction, the expected error of a weight, the reason of a refusal, and
whether the recording is sufficient. The guidance reads no clock and no file: it follows a recording as it
follows a live machine.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from cylforce.commissioning import coverage, reaches
from cylforce.commissioning.coverage import Plan
from cylforce.commissioning.expectation import expected_error, postures
from cylforce.commissioning.explained import row_noise
from cylforce.commissioning.reaches import Reach, next_reach
from cylforce.commissioning.strokes import Stroke, clear_range, next_stroke, reach_sentence, sentence
from cylforce.commissioning.suspicion import refusal_sentence
from cylforce.commissioning.wiring import SignalHistory, empty_history, extended_history
from cylforce.estimation.batch import Fit, least_squares
from cylforce.estimation.blocks import Factors, chosen, joined
from cylforce.estimation.model import Model, Tares
from cylforce.estimation.observation import BLOCK_SECONDS, MOST_BLOCKS, Observed, block_factors, observe
from cylforce.estimation.priors.prior import Prior
from cylforce.estimation.segments import gapless
from cylforce.mechanics.workspace import drive_angles
from cylforce.signals.estimate import Array

FIRST_S = 16.0  # s of motion before the first judgement; chosen
LONGEST_S = 270.0  # s of motion after which missing strokes are no longer requested; chosen
SHORT_S = 60.0  # s, as LONGEST_S, for another tool on an arm that is identified already; chosen
UNMOVED_S = 60.0  # s of motion of other joints after which a joint that never moved is requested first; chosen
CREEPING_S = 10.0  # s of motion too slow to count, after which faster motion is requested; chosen
GOOD_ENOUGH = 0.01  # expected error of a weight without the scale's, at which it ends, times rated payload; chosen
LIKELY = 95.0  # percentile over the working range that the expected error is; chosen


class Judgement(NamedTuple):
    """Judgement of the samples so far.

    weight_error: expected standard error of a weight [kg], not exceeded in LIKELY per cent of the postures, without
        that of the scale, which the empty machine cannot reduce; NaN: not yet known; infinite: weighing is impossible
        in more than 100 - LIKELY per cent of them
    refusal: one sentence why the samples are refused, or None
    """

    weight_error: float
    refusal: str | None


class Collected(NamedTuple):
    """State of the guidance.

    tail: (K, S) last samples, not yet processed or needed to settle the filters [SI]
    data: factors of all processed samples; None: none yet
    covered: (M, BINS, 2, 2) coverage [s]
    planes: (M-1, BINS, BINS) coverage of pairs of joints [s]
    moved_s: time of motion [s]
    crept_s: time of motion that is too slow to count [s]: the fastest cylinder at 0.2 to 1 times `Plan.rest`
    posture: (N,) present angles of `drive` [rad]; NaN: unknown
    evidence: history of the raw signals
    waiting: number of samples since the last judgement, or since the beginning
    judgement: the last judgement
    stroke: the stroke or move that is requested; None: none
    """

    tail: Array
    data: Factors | None
    covered: Array
    planes: Array
    moved_s: float
    crept_s: float
    posture: Array
    evidence: SignalHistory
    waiting: int
    judgement: Judgement
    stroke: Stroke | Reach | None


class Advice(NamedTuple):
    """Advice to the operator.

    seconds: time of motion so far [s]
    covered: (M, BINS, 2, 2) coverage [s]
    visited: share (0..1) of the pairs of angles of neighbouring joints that were visited
    posture: (N,) present angles of `drive` [rad]; NaN: unknown
    weight_error: expected standard error of a weight [kg], as in `Judgement`
    stroke: the stroke or move to make next; None: none
    instruction: sentence for the operator
    refusal: one sentence why the recording is refused, or None
    done: whether the recording is sufficient
    """

    seconds: float
    covered: Array
    visited: float
    posture: Array
    weight_error: float
    stroke: Stroke | Reach | None
    instruction: str
    refusal: str | None
    done: bool


@dataclass(frozen=True)
class Guide:
    """Guidance of one machine. Its state, `Collected`, is passed in and returned.

    model: model of the empty machine
    every_s: time between two judgements [s]
    common: prior of a machine whose arm was identified with another tool, so that a minute of motion is enough
        (SHORT_S); None: prior of the data sheet
    """

    model: Model
    every_s: float = BLOCK_SECONDS
    common: Prior | None = None

    @cached_property
    def plan(self) -> Plan:
        """Return the motion that the recording must contain."""
        machine = self.model.machine
        return coverage.plan(machine, 2.0 * self.model.filters.direction_speed, clear_range(machine))

    @cached_property
    def _places(self) -> reaches.Postures:
        """Return the postures of all joints that may be requested of the operator."""
        return reaches.postures(self.model.machine, self.plan)

    @cached_property
    def _working(self) -> Array:
        """Return the postures (A, B, N) [rad] in which a weight is expected."""
        return postures(self.model.machine).theta

    def begin(self) -> Collected:
        """Return the state before any sample."""
        machine = self.model.machine
        return self._advised(
            Collected(
                tail=np.zeros((0, len(machine.signals))),
                data=None,
                covered=np.zeros_like(self.plan.needed),
                planes=np.zeros(self._places.pairs.shape),
                moved_s=0.0,
                crept_s=0.0,
                posture=np.full(machine.size, np.nan),
                evidence=empty_history(machine),
                waiting=0,
                judgement=Judgement(weight_error=np.nan, refusal=None),
                stroke=None,
            )
        )

    def interrupt(self, state: Collected) -> Collected:
        """Return the state after a gap: the next samples do not follow the last ones."""
        return state._replace(tail=state.tail[:0])

    def take(self, state: Collected, values: Array) -> Collected:
        """Return the state after further samples (T, S) [SI].

        They follow the last ones without a gap unless `interrupt` was called.
        """
        evidence = extended_history(self.model, state.evidence, values, joins=len(state.tail) > 0)
        tail = np.concatenate([state.tail, values])
        state = state._replace(evidence=evidence, tail=tail, waiting=state.waiting + len(values))
        block, settle = int(BLOCK_SECONDS * self.model.filters.rate_hz), self.model.settle_steps + 1
        count = (len(tail) - settle) // block
        if count < 1:
            return state
        state = self._add(state, observe(self.model, tail[: settle + count * block]))
        return self._advised(self._judged(state._replace(tail=tail[count * block :])))

    def _add(self, state: Collected, rows: Observed) -> Collected:
        """Return the state with the rows of further processed samples."""
        dt, new = 1.0 / self.model.filters.rate_hz, block_factors(self.model, rows)
        fastest = np.max(np.abs(rows.speed), axis=1, initial=0.0)
        posture = drive_angles(self.model.machine, rows.posture)
        creeps = np.logical_and(fastest > 0.2 * self.plan.rest, fastest <= self.plan.rest)
        return state._replace(
            data=joined([new] if state.data is None else [state.data, new], MOST_BLOCKS),
            covered=state.covered + coverage.coverage(self.plan, posture, rows.speed, dt),
            planes=state.planes + coverage.planes(self.plan, posture, rows.speed, dt),
            moved_s=state.moved_s + dt * float(np.sum(fastest > self.plan.rest)),
            crept_s=state.crept_s + dt * float(np.sum(creeps)),
            posture=posture[-1],
        )

    def _judged(self, state: Collected) -> Collected:
        """Return the state with a new judgement, when one is due: expected error of a weight [kg], and refusal.

        It is due after `every_s` of samples since the last one, when FIRST_S of motion are recorded and some rows are
        usable. The parameters of the empty machine are fitted to all samples so far by least squares.
        """
        if state.data is None or state.waiting < self.every_s * self.model.filters.rate_hz or state.moved_s < FIRST_S:
            return state
        data = chosen(state.data, list(range(len(self.model.parameters))))  # the columns of the parameters only
        if not np.any(data.samples):
            return state
        noise = row_noise(data, self.model.prior)
        fit = least_squares(data, noise, self.common or self.model.prior)
        refusal = refusal_sentence(self.model, state.data, state.evidence)
        return state._replace(waiting=0, judgement=Judgement(self._weight_error(data, noise, fit), refusal))

    def _weight_error(self, data: Factors, noise: Array, fit: Fit) -> float:
        """Return the expected standard error of a weight [kg]: the percentile LIKELY over the working range.

        data: factors of all samples, for the parameters of the empty machine
        noise: (R,) rms residual of each measured torque that is fitted alone [N m]
        fit: the fit of these parameters
        """
        model = self.model
        measured = np.sum(data.samples, axis=0) > 0
        row_error = np.where(measured, np.maximum(fit.row_error, 1e-3 * noise + 1e-9), model.data_sheet.row_error)
        tares = Tares(
            friction=model.friction,
            names=tuple(p.name for p in model.parameters),
            values=fit.values,
            covariance=fit.covariance,
            row_error=row_error,
            identified=True,
        )
        error = expected_error(model, tares, self._working).standard_error
        return float(np.percentile(np.where(np.isnan(error), np.inf, error), LIKELY))

    def _advised(self, state: Collected) -> Collected:
        """Return the state with the next stroke; when no stroke is missing, with the next move of all joints."""
        machine, plan, last = self.model.machine, self.plan, state.stroke
        last_stroke = last if isinstance(last, Stroke) else None
        stroke = next_stroke(machine, plan, state.covered, state.posture, last_stroke)
        if stroke is not None:
            return state._replace(stroke=stroke)
        last_reach = last if isinstance(last, Reach) else None
        return state._replace(stroke=next_reach(machine, plan, self._places, state.planes, state.posture, last_reach))

    def advice(self, state: Collected) -> Advice:
        """Return the advice in this state."""
        judged, enough = state.judgement, GOOD_ENOUGH * self.model.machine.rated_payload
        longest = LONGEST_S if self.common is None else SHORT_S
        complete = state.stroke is None or state.moved_s >= longest
        done = complete and judged.refusal is None and judged.weight_error <= enough
        return Advice(
            seconds=state.moved_s,
            covered=state.covered,
            visited=reaches.visited(self._places, state.planes),
            posture=state.posture,
            weight_error=judged.weight_error,
            stroke=state.stroke,
            instruction=judged.refusal or ("enough: the machine may rest" if done else self._instruction(state)),
            refusal=judged.refusal,
            done=done,
        )

    def _instruction(self, state: Collected) -> str:
        """Return the sentence that requests the next motion from the operator."""
        if state.crept_s > max(CREEPING_S, state.moved_s):
            return f"move faster: cylinders below {1e3 * self.plan.rest:.0f} mm/s do not show which way friction acts"
        if state.stroke is None:
            return (
                "move all joints at once through their ranges, slowly and fast, until the weight is known well enough"
            )
        if isinstance(state.stroke, Reach):
            return reach_sentence(self.model.machine, self.plan, state.stroke)
        return self._unmoved(state) or sentence(self.model.machine, self.plan, state.stroke)

    def _unmoved(self, state: Collected) -> str | None:
        """Return the sentence that requests motion of a joint that never moved, once others moved for UNMOVED_S."""
        still = [j for j, s in zip(self.plan.joints, np.sum(state.covered, axis=(1, 2, 3)), strict=True) if s == 0.0]
        if not still or state.moved_s < UNMOVED_S:
            return None
        name = self.model.machine.links[still[0]].name
        return f"the {name} has not moved yet: move it both ways, slowly and fast; if it did move, its sensor is dead"

    def absorb(self, state: Collected, rows: Array, longest: int) -> Collected:
        """Return the state after the rows of further ticks.

        A longer gap than `longest` interrupts the recording, as does one at the beginning or the end of the rows.

        rows: (T, S) samples [SI], NaN where a signal was missing
        longest: gaps of up to this many rows are filled by linear interpolation
        """
        parts = gapless(rows, longest)
        if not parts or not np.all(np.isfinite(rows[0])):
            state = self.interrupt(state)
        for k, part in enumerate(parts):
            state = self.take(self.interrupt(state) if k else state, part)
        return state if np.all(np.isfinite(rows[-1:])) else self.interrupt(state)


def follow(guide: Guide, segments: Iterable[Array]) -> Iterator[Advice]:
    """Yield the advice along a recording, after every block of BLOCK_SECONDS, until it is refused or sufficient.

    segments: samples (T, S) without gaps [SI]
    """
    state, step = guide.begin(), int(BLOCK_SECONDS * guide.model.filters.rate_hz)
    for segment in segments:
        for first in range(0, len(segment), step):
            state = guide.take(state, segment[first : first + step])
            advice = guide.advice(state)
            yield advice
            if advice.done or advice.refusal is not None:
                return
        state = guide.interrupt(state)
