"""Guidance through the commissioning of the empty machine: samples in, advice out. The advice says what is missing,
what to do next, how accurate a weight would be, why the recording is refused, and when it is sufficient. Pure: it
follows a recording in the same way as a live machine."""

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
from cylforce.commissioning.suspicion import doubt
from cylforce.commissioning.wiring import SignalHistory, gathered, nothing
from cylforce.estimation.batch import Fit, least_squares
from cylforce.estimation.blocks import Factors, chosen, joined
from cylforce.estimation.model import Model, Tares
from cylforce.estimation.observation import BLOCK_SECONDS, MOST_BLOCKS, Observed, block_factors, observe
from cylforce.estimation.priors.prior import Prior
from cylforce.estimation.segments import gapless
from cylforce.mechanics.workspace import drive_angles
from cylforce.signals.estimate import Array

FIRST_S = 16.0  # s of motion before the first judgement; chosen
LONGEST_S = 270.0  # s of motion after which missing strokes are no longer asked for; chosen
SHORT_S = 60.0  # the same where the arm is known already; chosen: the minute that another tool may take
UNMOVED_S = 60.0  # s of motion of other joints, after which a joint that never moved is asked for first; chosen
CREEPING_S = 10.0  # s of motion that is too slow to count, after which faster motion is asked for; chosen
GOOD_ENOUGH = 0.01  # times the rated payload: expected error, the scale's apart, at which it ends; chosen
LIKELY = 95.0  # percentile of that standard error over the working range; chosen


class Judgement(NamedTuple):
    """Judgement of the samples so far: expected `weight_error` [kg] without the error of the scale, which the motion of
    the empty machine cannot reduce (NaN: not yet known); `refusal`: one sentence why
    they are refused, or None."""

    weight_error: float
    refusal: str | None


class Collected(NamedTuple):
    """State of the guidance: last samples `tail` (T, S), not yet processed or needed to settle filters; factors `data`
    of all processed samples; coverage `covered` (M, BINS, 2, 2) [s] and `planes` (M-1, BINS, BINS) [s] of pairs of
    joints; time of motion `moved_s` and of motion too slow to count `crept_s` [s]; present `posture` (N,) [rad], angles
    of `drive`; `evidence` of the raw samples; `waiting`: number of samples since the last `judgement`; the `stroke`
    asked for."""

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
    """Advice to the operator: `seconds` of motion so far; coverage `covered` (M, BINS, 2, 2) [s]; share `visited`
    (0..1) of the pairs of postures; present `posture` (N,) [rad], angles of `drive`; expected `weight_error` [kg]
    (NaN: not yet known); the `stroke` to make next; the sentence to `say`; `refusal`: one sentence why the recording is
    refused, or None; `done`: whether it is sufficient."""

    seconds: float
    covered: Array
    visited: float
    posture: Array
    weight_error: float
    stroke: Stroke | Reach | None
    say: str
    refusal: str | None
    done: bool


@dataclass(frozen=True)
class Guide:
    """The guidance of one machine; a new judgement is made after every `every_s` [s] of samples."""

    model: Model
    every_s: float = BLOCK_SECONDS
    common: Prior | None = None  # of a machine whose arm is known from another tool: a minute is enough

    @cached_property
    def plan(self) -> Plan:
        """The motion that the recording must contain."""
        machine = self.model.machine
        return coverage.plan(machine, 2.0 * self.model.filters.direction_speed, clear_range(machine))

    @cached_property
    def _places(self) -> reaches.Postures:
        return reaches.postures(self.model.machine, self.plan)

    @cached_property
    def _working(self) -> Array:
        return postures(self.model.machine).theta

    def begin(self) -> Collected:
        """The state before any sample."""
        machine = self.model.machine
        here, none = np.full(machine.size, np.nan), np.zeros((0, len(machine.signals)))
        start = Judgement(np.nan, None)
        covered = np.zeros_like(self.plan.needed)
        empty = Collected(
            none, None, covered, np.zeros(self._places.pairs.shape), 0.0, 0.0, here, nothing(machine), 0, start, None
        )
        return self._advised(empty)

    def interrupt(self, state: Collected) -> Collected:
        """The state after a gap: the next samples do not follow the last ones."""
        return state._replace(tail=state.tail[:0])

    def take(self, state: Collected, values: Array) -> Collected:
        """The state after further samples (T, S), which follow the last ones without a gap unless `interrupt` was
        called."""
        evidence = gathered(self.model, state.evidence, values, joins=len(state.tail) > 0)
        tail = np.concatenate([state.tail, values])
        state = state._replace(evidence=evidence, tail=tail, waiting=state.waiting + len(values))
        block, settle = int(BLOCK_SECONDS * self.model.filters.rate_hz), self.model.settle_steps + 1
        count = (len(tail) - settle) // block
        if count < 1:
            return state
        state = self._add(state, observe(self.model, tail[: settle + count * block]))
        return self._advised(self._judged(state._replace(tail=tail[count * block :])))

    def _add(self, state: Collected, seen: Observed) -> Collected:
        dt, new = 1.0 / self.model.filters.rate_hz, block_factors(self.model, seen)
        fastest = np.max(np.abs(seen.speed), axis=1, initial=0.0)
        posture = drive_angles(self.model.machine, seen.posture)
        creeps = np.logical_and(fastest > 0.2 * self.plan.rest, fastest <= self.plan.rest)
        return state._replace(
            data=joined([new] if state.data is None else [state.data, new], MOST_BLOCKS),
            covered=state.covered + coverage.coverage(self.plan, posture, seen.speed, dt),
            planes=state.planes + coverage.planes(self.plan, posture, seen.speed, dt),
            moved_s=state.moved_s + dt * float(np.sum(fastest > self.plan.rest)),
            crept_s=state.crept_s + dt * float(np.sum(creeps)),
            posture=posture[-1],
        )

    def _judged(self, state: Collected) -> Collected:
        """The state, with a new judgement when `every_s` of samples have come since the last one, FIRST_S of motion are
        recorded, and some rows are usable."""
        if state.data is None or state.waiting < self.every_s * self.model.filters.rate_hz or state.moved_s < FIRST_S:
            return state
        data = chosen(state.data, list(range(len(self.model.parameters))))
        if not np.any(data.samples):
            return state
        noise = row_noise(data, self.model.prior)
        fit = least_squares(data, noise, self.common or self.model.prior)
        refusal = doubt(self.model, state.data, state.evidence)
        return state._replace(waiting=0, judgement=Judgement(self._weight_error(data, noise, fit), refusal))

    def _weight_error(self, data: Factors, noise: Array, fit: Fit) -> float:
        model = self.model
        seen = np.sum(data.samples, axis=0) > 0
        left = np.where(seen, np.maximum(fit.row_error, 1e-3 * noise + 1e-9), model.data_sheet.row_error)
        names = tuple(p.name for p in model.parameters)
        tares = Tares(model.friction, names, fit.values, fit.covariance, left, True)
        error = expected_error(model, tares, self._working).standard_error
        return float(np.percentile(np.where(np.isnan(error), np.inf, error), LIKELY))

    def _advised(self, state: Collected) -> Collected:
        machine, plan, last = self.model.machine, self.plan, state.stroke
        made = last if isinstance(last, Stroke) else None
        stroke = next_stroke(machine, plan, state.covered, state.posture, made)
        if stroke is not None:
            return state._replace(stroke=stroke)
        gone = last if isinstance(last, Reach) else None
        return state._replace(stroke=next_reach(machine, plan, self._places, state.planes, state.posture, gone))

    def advice(self, state: Collected) -> Advice:
        """The advice in this state."""
        judged, enough = state.judgement, GOOD_ENOUGH * self.model.machine.rated_payload
        longest = LONGEST_S if self.common is None else SHORT_S
        complete = state.stroke is None or state.moved_s >= longest
        done = complete and judged.refusal is None and judged.weight_error <= enough
        say = judged.refusal or ("enough: the machine may rest" if done else self._say(state))
        seen = reaches.visited(self._places, state.planes)
        shown = (state.moved_s, state.covered, seen, state.posture, judged.weight_error)
        return Advice(*shown, state.stroke, say, judged.refusal, done)

    def _say(self, state: Collected) -> str:
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
        still = [j for j, s in zip(self.plan.joints, np.sum(state.covered, axis=(1, 2, 3)), strict=True) if s == 0.0]
        if not still or state.moved_s < UNMOVED_S:
            return None
        name = self.model.machine.links[still[0]].name
        return f"the {name} has not moved yet: move it both ways, slowly and fast; if it did move, its sensor is dead"

    def absorb(self, state: Collected, rows: Array, longest: int) -> Collected:
        """The state after the rows (T, S) of further ticks, NaN where a signal was missing; gaps of up to `longest`
        rows are filled by linear interpolation."""
        parts = gapless(rows, longest)
        if not parts or not np.all(np.isfinite(rows[0])):
            state = self.interrupt(state)
        for k, part in enumerate(parts):
            state = self.take(self.interrupt(state) if k else state, part)
        return state if np.all(np.isfinite(rows[-1:])) else self.interrupt(state)


def follow(guide: Guide, segments: Iterable[Array]) -> Iterator[Advice]:
    """The advice along a recording, after every block of BLOCK_SECONDS, until it is refused or sufficient; `segments`:
    samples (T, S) without gaps."""
    state, step = guide.begin(), int(BLOCK_SECONDS * guide.model.filters.rate_hz)
    for segment in segments:
        for first in range(0, len(segment), step):
            state = guide.take(state, segment[first : first + step])
            advice = guide.advice(state)
            yield advice
            if advice.done or advice.refusal is not None:
                return
        state = guide.interrupt(state)
