"""What the report of a gap draws, from the diagnosis: pure."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cylforce.diagnosis import Diagnosis
from cylforce.diagnosis.explain import Cause, Picture, Simulation
from cylforce.diagnosis.model import REGIMES, regime_rms
from cylforce.diagnosis.search import FieldQuestion
from cylforce.diagnosis.statistics import rms
from cylforce.effects.fault import Place
from cylforce.effects.library import Proposal
from cylforce.mechanics.machine import Machine
from cylforce.programs.reports import evidence
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind

STRETCH_S = 30.0
SEED = 1  # of the bootstrap of a closure, which is not drawn


@dataclass(frozen=True)
class Heat:
    """Residual [N m, rms] of R joints in G regimes.

    joints:        names (R)
    regimes:       names (G)
    before, after: (R, G) with no effect, and with the named effects simulated
    healthy:       (R, G) of a healthy machine
    """

    joints: tuple[str, ...]
    regimes: tuple[str, ...]
    before: Array
    after: Array
    healthy: Array

    def excess(self, values: Array) -> Array:
        """Return a residual (R, G) in multiples of that of a healthy machine."""
        return np.asarray(values / self.healthy)


@dataclass(frozen=True)
class Overlay:
    """The half minute in which an effect shows most at a joint on which it acts.

    title:     effect and joint
    recording: its name
    t:         (T,) [s]
    residual:  (T,) without the effect [N m]
    effect:    (T,) torque of the effect, simulated [N m]
    """

    title: str
    recording: str
    t: Array
    residual: Array
    effect: Array


@dataclass(frozen=True)
class Step:
    """A step of the residual.

    label:    what is done
    residual: (R,) [N m, rms]
    """

    label: str
    residual: Array


@dataclass(frozen=True)
class Shown:
    """Everything that is drawn.

    heat:          joints by regimes
    before, after: samples of all field recordings, thinned; the residual as measured torque
    overlays:      of the named effects
    steps:         how the residual falls
    picture:       pressure at the worst place, measured and simulated
    """

    heat: Heat
    before: evidence.DrawnSamples
    after: evidence.DrawnSamples
    overlays: tuple[Overlay, ...]
    steps: tuple[Step, ...]
    picture: Picture | None


def shown(found: Diagnosis) -> Shown:
    """Return what is drawn of a diagnosis; of a working machine no effect as simulated."""
    question, both = found.evidence.found.question, found.simulated
    causes = [named.cause for named in found.named] if found.evidence.found.work is None else []
    stages = [
        both.before,
        *(_simulated(found, causes[:k]) for k in range(1, len(causes))),
        *([both.after] * bool(causes)),
    ]
    labels = [f"+ {readable(cause.key)}" for cause in causes]
    steps = [Step("as it was, parameters fixed", found.refit.before), Step("parameters refitted", found.refit.after)]
    steps += [Step(label, rms(stage)) for label, stage in zip(labels, stages[1:], strict=True)]
    steps.append(Step("noise floor", question.machine.floor.rms))
    return Shown(
        _heat(question, both.before, both.after),
        _points(question, both.before),
        _points(question, both.after),
        tuple(_overlay(question, c.proposal, *stages[k : k + 2]) for k, c in enumerate(causes)),
        tuple(steps),
        found.picture,
    )


def _simulated(found: Diagnosis, causes: Sequence[Cause]) -> list[Array]:
    """Return the residuals with only some of the named causes."""
    candidate = found.evidence.best_of(found.named[0].cause.key)
    question = found.evidence.found.question
    return Simulation(question, candidate).run(causes, np.random.default_rng(SEED)).after


def _heat(question: FieldQuestion, before: Sequence[Array], after: Sequence[Array]) -> Heat:
    model, machine = question.machine.regressors.model, question.machine
    rows, recordings = [s.rows for s in question.seen], [s.recording for s in question.seen]
    tables = [regime_rms(model, rows, recordings, residuals).T for residuals in (before, after)]
    regimes = np.full((len(REGIMES), len(machine.floor.rms)), np.nan) if machine.regimes is None else machine.regimes
    healthy = np.where(np.isfinite(regimes), regimes, machine.floor.rms).T
    names = tuple(model.machine.links[j].name for j in model.machine.rows)
    return Heat(names, REGIMES, tables[0], tables[1], healthy)


def _points(question: FieldQuestion, residuals: Sequence[Array]) -> evidence.DrawnSamples:
    """Return thinned samples of all recordings with their residuals."""
    regressors = question.machine.regressors
    joints, cylinders = movers(question)
    parts = []
    for seen, residual in zip(question.seen, residuals, strict=True):
        moved = evidence.drives(regressors.slow, joints, cylinders, regressors.thinned(seen.recording.values))
        parts.append(evidence.DrawnSamples(residual, np.zeros_like(residual), seen.rows.posture, *moved))
    step = -(-sum(len(p.speed) for p in parts) // evidence.MOST_POINTS)
    return evidence.DrawnSamples(*(np.concatenate(column)[::step] for column in zip(*parts, strict=True)))


def movers(question: FieldQuestion) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the joints whose torque is measured, and the cylinder that moves each."""
    model = question.machine.regressors.model
    return tuple(model.machine.rows), tuple(acting[0] for acting in model.acting)


def acts_on(machine: Machine, proposal: Proposal) -> list[int]:
    """Return the measured joints, by row, on which an effect acts: those that its cylinder, sensor or link moves."""
    place, where = proposal.about.place, proposal.where
    joints: tuple[int, ...] = machine.rows
    if place in (Place.PRESSURE, Place.ANGLE, Place.SENSOR):
        signal = machine.signals[where]
        angle = signal.kind in (Kind.JOINT_ANGLE, Kind.LINK_INCLINATION)
        joints = (signal.index,) if angle else machine.spans[signal.index]
    elif place is Place.CYLINDER:
        joints = machine.spans[where]
    elif place is Place.LINK:
        joints = (where,)
    return [r for r, j in enumerate(machine.rows) if j in joints] or list(range(len(machine.rows)))


def _overlay(
    question: FieldQuestion, proposal: Proposal, without: Sequence[Array], simulated: Sequence[Array]
) -> Overlay:
    machine = question.machine.regressors.model.machine
    own = [a - b for a, b in zip(without, simulated, strict=True)]
    k, r, span = _most(question, own, acts_on(machine, proposal))
    seen = question.seen[k]
    title = f"{readable((proposal.name, proposal.at))}: {machine.links[machine.rows[r]].name} torque"
    return Overlay(title, seen.recording.name, seen.rows.t[span], without[k][span, r], own[k][span, r])


def readable(key: tuple[str, str]) -> str:
    """Return name and place of an effect in words."""
    return f"{key[0].replace('_', ' ')} at {key[1]}" if key[1] else key[0]


def _most(question: FieldQuestion, own: Sequence[Array], rows: list[int]) -> tuple[int, int, slice]:
    """Return the recording, one of some rows and the stretch in which a torque is largest against the noise floor."""
    length, best, most = round(STRETCH_S * question.machine.regressors.rows_hz), (0, rows[0], slice(0, None)), -1.0
    for k, torque in enumerate(own):
        squares = np.nan_to_num((torque / question.machine.floor.rms)[:, rows]) ** 2
        totals = np.cumsum(np.vstack([np.zeros_like(squares[:1]), squares]), axis=0)
        width = min(length, len(squares))
        inside = totals[width:] - totals[:-width]
        at, r = np.unravel_index(int(np.argmax(inside)), inside.shape)
        if inside[at, r] > most:
            most, best = float(inside[at, r]), (k, rows[int(r)], slice(int(at), int(at) + width))
    return best
