"""Guidance through the commissioning of the empty machine: samples in, advice out. Pure, so that a recording can be
followed like a bus: what is missing, what to do next, how well weight would be known, what is refused and what is
enough."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from cylforce.commissioning import coverage, reaches
from cylforce.commissioning.coverage import Plan
from cylforce.commissioning.expectation import expected_error, postures
from cylforce.commissioning.identification import row_noise
from cylforce.commissioning.reaches import Reach, next_reach
from cylforce.commissioning.strokes import Stroke, clear_range, next_stroke, reach_sentence, sentence
from cylforce.commissioning.suspicion import doubt
from cylforce.commissioning.wiring import SignalHistory, gathered, nothing
from cylforce.estimation.batch import Fit, least_squares
from cylforce.estimation.blocks import Factors, chosen, joined
from cylforce.estimation.model import Model, Tares
from cylforce.estimation.observation import BLOCK_SECONDS, MOST_BLOCKS, Observed, block_factors, observe
from cylforce.estimation.segments import gapless
from cylforce.signals.estimate import Array

FIRST_S = 16.0  # of motion before anything is concluded
LONGEST_S = 270.0  # of motion: what is not told by then is told by the data sheet
UNMOVED_S = 60.0  # of motion of others, after which a joint that never moved is asked for first
CREEPING_S = 10.0  # of motion too slow to count
GOOD_ENOUGH = 0.01  # expected standard error, as a share of the rated payload, with which to end
LIKELY = 95.0  # percentile of it over the working range


class Judgement(NamedTuple):
    """What the samples so far give: expected `weight_error` [kg] (NaN: not yet), a sentence why they are refused."""

    weight_error: float
    refusal: str | None


class Collected(NamedTuple):
    """What was collected: samples `tail` (T, S) that wait for their successors, the last of them, the factors `data`,
    seconds `covered` (M, BINS, 2, 2), `planes` (M-1, BINS, BINS) of pairs of joints, seconds of motion and of motion
    too slow to count, the joints' `posture` (N,) now, the raw samples' evidence, samples since the last judgement and
    that, the stroke asked for."""

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
    """`seconds` of motion, what is `covered` (M, BINS, 2, 2) [s], the share of common postures that were
    `visited` (0..1), the joints' `posture` (N,) [rad], the expected
    `weight_error` [kg] (NaN: not yet), the `stroke` to make next and what to `say`; `refusal`: a sentence why this
    cannot be commissioned; `done`: enough."""

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
    """The guidance of one machine; after every `every_s` of samples it thinks again."""

    model: Model
    every_s: float = BLOCK_SECONDS

    @cached_property
    def plan(self) -> Plan:
        """What is to be covered."""
        machine = self.model.machine
        return coverage.plan(machine, 2.0 * self.model.filters.direction_speed, clear_range(machine))

    @cached_property
    def _places(self) -> reaches.Postures:
        return reaches.postures(self.model.machine, self.plan)

    @cached_property
    def _working(self) -> Array:
        return postures(self.model.machine).theta

    def begin(self) -> Collected:
        """Nothing is known yet."""
        machine = self.model.machine
        here, none = np.full(machine.size, np.nan), np.zeros((0, len(machine.signals)))
        start = Judgement(np.nan, None)
        covered = np.zeros_like(self.plan.needed)
        empty = Collected(
            none, None, covered, np.zeros(self._places.pairs.shape), 0.0, 0.0, here, nothing(machine), 0, start, None
        )
        return self._advised(empty)

    def interrupt(self, state: Collected) -> Collected:
        """Samples are missing: what comes next does not follow on what was."""
        return state._replace(tail=state.tail[:0])

    def take(self, state: Collected, values: Array) -> Collected:
        """Take in samples (T, S), without a gap since the last ones unless interrupted."""
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
        creeps = np.logical_and(fastest > 0.2 * self.plan.rest, fastest <= self.plan.rest)
        return state._replace(
            data=joined([new] if state.data is None else [state.data, new], MOST_BLOCKS),
            covered=state.covered + coverage.coverage(self.plan, seen.posture, seen.speed, dt),
            planes=state.planes + coverage.planes(self.plan, seen.posture, seen.speed, dt),
            moved_s=state.moved_s + dt * float(np.sum(fastest > self.plan.rest)),
            crept_s=state.crept_s + dt * float(np.sum(creeps)),
            posture=seen.posture[-1],
        )

    def _judged(self, state: Collected) -> Collected:
        """With a new judgement when it is time."""
        if state.data is None or state.waiting < self.every_s * self.model.filters.rate_hz or state.moved_s < FIRST_S:
            return state
        data = chosen(state.data, list(range(len(self.model.parameters))))
        if not np.any(data.samples):
            return state
        noise = row_noise(data, self.model.prior)
        fit = least_squares(data, noise, self.model.prior)
        refusal = doubt(self.model, state.data, noise, fit, state.evidence)
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
        """What to show, and what to do next."""
        judged, enough = state.judgement, GOOD_ENOUGH * self.model.machine.rated_payload
        told = state.stroke is None or state.moved_s >= LONGEST_S
        done = told and judged.refusal is None and judged.weight_error <= enough
        say = judged.refusal or ("enough: the machine may rest" if done else self._say(state))
        seen = reaches.visited(self._places, state.planes)
        shown = (state.moved_s, state.covered, seen, state.posture, judged.weight_error)
        return Advice(*shown, state.stroke, say, judged.refusal, done)

    def _say(self, state: Collected) -> str:
        if state.crept_s > max(CREEPING_S, state.moved_s):
            return f"move faster: cylinders below {1e3 * self.plan.rest:.0f} mm/s tell no direction of friction"
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
        """Take in rows (T, S) of ticks, NaN where something was missing: gaps of up to `longest` rows are bridged."""
        parts = gapless(rows, longest)
        if not parts or not np.all(np.isfinite(rows[0])):
            state = self.interrupt(state)
        for k, part in enumerate(parts):
            state = self.take(self.interrupt(state) if k else state, part)
        return state if np.all(np.isfinite(rows[-1:])) else self.interrupt(state)


def follow(guide: Guide, segments: Iterable[Array]) -> Iterator[Advice]:
    """The advice along a recording's gapless segments of samples (T, S), every two seconds, until it is refused or
    done."""
    state, step = guide.begin(), int(BLOCK_SECONDS * guide.model.filters.rate_hz)
    for segment in segments:
        for first in range(0, len(segment), step):
            state = guide.take(state, segment[first : first + step])
            advice = guide.advice(state)
            yield advice
            if advice.done or advice.refusal is not None:
                return
        state = guide.interrupt(state)
