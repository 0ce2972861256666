"""Answer of `cylforce gap --json` as plain values, stable and documented."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cylforce.diagnosis import Diagnosis, Named, SheetGap
from cylforce.diagnosis.decide import Verdict
from cylforce.diagnosis.explain import Refit, Spot, force_error, smallest_detectable, weight_error
from cylforce.diagnosis.model import KnowledgeSource
from cylforce.diagnosis.search import NO_GAP, UNKNOWN, FieldQuestion, Key
from cylforce.diagnosis.statistics import rms
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array
from cylforce.signals.units import BAR

MOST_LISTED = 3  # causes of a machine at work that are listed
MOST_PARAMETERS = 5
MOST_EVIDENCE = 20
SOURCES = {
    KnowledgeSource.REFERENCES: "references",
    KnowledgeSource.SIMULATION: "simulation",
    KnowledgeSource.IDENTIFICATION: "identification",
    KnowledgeSource.DATA_SHEET: "data_sheet",
}
CONFIRM = {  # whether a shape of an unexplained residual is real
    "speed": "move the {at} alone at five speeds, both ways: does it follow the same curve?",
    "position": "move the {at} alone, slowly, thrice through its range and back: does it return at the same angles?",
    "load": "repeat the same moves of the {at} empty and with two known loads: does it grow with the load?",
    "time": "repeat the same moves of the {at} every ten minutes: does it go on changing?",
    "moments": "repeat the moves at which it shows, see the plot of the {at}: does it return?",
}
IDENTIFY = (
    "identify the machine from its own recordings (cylforce identify MACHINE.toml RECORDING... -o identified.toml), "
    "then diagnose with --identified identified.toml: only what that leaves is a gap"
)
BECAUSE = {
    KnowledgeSource.DATA_SHEET: "nobody has identified this machine",
    KnowledgeSource.SIMULATION: "the simulation's masses and friction are not this machine's",
    KnowledgeSource.REFERENCES: "the model's masses and friction are not this machine's",
}
HEALTHY_MOTION = "record the machine in order in this very motion, as a reference"
LONGER = "a longer recording that moves every joint both ways, slowly and fast, empty and with a known load"


def answer(found: Diagnosis) -> dict[str, Any]:
    """Return the whole answer; SI units."""
    evidence, question, working = found.evidence, found.evidence.found.question, found.evidence.found.work is not None
    shaped = found.verdict in (Verdict.UNKNOWN, Verdict.PARTLY)
    hidden = _hidden(found)
    whole = {
        "verdict": str(found.verdict),
        "compared_with": SOURCES[question.machine.source],
        "gap": _gap(found),
        "where": [_spot(spot) for spot in found.spots],
        "effects": [_effect(named, found) for named in found.named],
        "explained": None if working else _known(found.simulated.closure if found.named else 0.0),
        "working": working,
        "end_quantities": None if working else _end_quantities(found),
        "not_observable": hidden,
        "next_experiment": _next(found, hidden),
        "unknown": found.shape if shaped else None,
    }
    if not found.only_parameters:
        whole |= {
            "probabilities": _probabilities(found),
            "set": [_place(key) for key in evidence.credible],
            "evidence": _evidence(found),
        }
    if found.parameters_first:
        whole |= identify_first(found.refit, BECAUSE[question.machine.source])
    if found.verdict is Verdict.NOT_OBSERVABLE:
        whole["reason"] = _reason(found)
    return whole


def sheet_answer(found: SheetGap) -> dict[str, Any]:
    """Return the answer when there is only a data sheet: it names no effect, the parameters come first."""
    question, refit = found.question, found.refit
    because = BECAUSE[KnowledgeSource.DATA_SHEET]
    gap = _sizes(question, refit, refit.before, refit.after)
    return {
        "verdict": str(Verdict.NOT_OBSERVABLE),
        "compared_with": SOURCES[KnowledgeSource.DATA_SHEET],
        "reason": because,
        "gap": gap | {"bar": _bars(question, question.residuals(), None), "simulated": []},
        "where": [_spot(spot) for spot in found.spots],
        "effects": [],
        "working": False,
        **identify_first(refit, because),
    }


def identify_first(refit: Refit, because: str) -> dict[str, Any]:
    """Return the key of the answer on the model's own parameters."""
    return {
        "identify_first": {
            "because": because,
            "before_nm": _total(refit.before),
            "after_nm": _total(refit.after),
            "share": refit.share,
            "parameters": [
                {"name": c.name, "unit": c.unit, "before": c.before, "after": c.after, "torque": c.torque}
                for c in refit.clear
            ],
        }
    }


def before_anything(whole: Mapping[str, Any]) -> list[str]:
    """Return the steps to be taken before any other experiment."""
    if "identify_first" in whole:
        return [IDENTIFY]
    if whole["verdict"] == Verdict.NOT_OBSERVABLE and not whole["working"]:
        return [HEALTHY_MOTION]
    unknown = whole["unknown"]
    return [CONFIRM[unknown["of"]].format(at=unknown["at"])] if unknown and unknown["of"] in CONFIRM else []


# The gap


def _gap(found: Diagnosis) -> dict[str, Any]:
    """Return the residual torque, rms [N m], in all and per joint, and the residual pressure per cylinder."""
    question = found.evidence.found.question
    return _sizes(question, found.refit, found.refit.before, rms(found.simulated.after)) | {
        "bar": _bars(question, found.simulated.before, found.simulated.after),
        "simulated": [_place(named.cause.key) | {"named": True} for named in found.named if _simulated(found)],
    }


def _simulated(found: Diagnosis) -> bool:
    return found.evidence.found.work is None


def _sizes(question: FieldQuestion, refit: Refit, fixed: Array, after: Array) -> dict[str, Any]:
    machine = question.machine.regressors.model.machine
    kinds = {"fixed": fixed, "refit": refit.after, "after": after, "floor": question.machine.floor.rms}
    names = [machine.links[j].name for j in machine.rows]
    shifts = sorted(refit.changes, key=lambda change: -abs(change.shift))[:MOST_PARAMETERS]
    return {
        "units": "N m",
        **{kind: _total(each) for kind, each in kinds.items()},
        "parameter_shift": [{"name": c.name, "standard_errors": c.shift} for c in shifts],
        "joints": {name: {kind: float(each[r]) for kind, each in kinds.items()} for r, name in enumerate(names)},
    }


def _spot(spot: Spot) -> dict[str, Any]:
    return {
        "channel": spot.joint,
        "regime": spot.regime,
        "share": spot.share,
        "p": spot.p,
        "found": spot.found,
        "rms_faulty": spot.residual,
        "rms_clean": spot.healthy,
        "floors": spot.floors,
    }


def _bars(
    question: FieldQuestion, before: Sequence[Array], after: Sequence[Array] | None
) -> dict[str, dict[str, float]]:
    """Return per measured cylinder the residual as pressure on its head side [bar, rms]."""
    machine = question.machine.regressors.model.machine
    floor = [np.broadcast_to(question.machine.floor.rms, e.shape) for e in before]
    kinds = {"fixed": before, "after": before if after is None else after, "floor": floor}
    each = {kind: rms(_pressures(question, residuals)).tolist() for kind, residuals in kinds.items()}
    names = [machine.cylinders[c].name for c in measured(machine)]
    return {name: {kind: values[k] for kind, values in each.items()} for k, name in enumerate(names)}


def measured(machine: Machine) -> list[int]:
    """Return the cylinders (from 0) whose force is measured and acts on a measured torque."""
    acting = {c for c, span in enumerate(machine.spans) if set(span) & set(machine.rows)}
    return [c for c in sorted(acting) if machine.forces_measured[c]]


def _pressures(question: FieldQuestion, residuals: Sequence[Array]) -> list[Array]:
    """Return residuals (T, R) [N m] as pressures (T, C) [bar] on the head side of the measured cylinders.

    pressure = torque / lever / area, the rod side as recorded. Several cylinders of a joint share it by their levers.
    """
    machine, found = question.machine.regressors.model.machine, []
    chosen, rows = measured(machine), list(machine.rows)
    acts = np.array([[j in machine.spans[c] for j in rows] for c in chosen])
    area = np.array([machine.cylinders[c].area_head for c in chosen])
    for seen, residual in zip(question.seen, residuals, strict=True):
        lever = machine.geometry(seen.rows.posture).lever[:, chosen][:, :, rows]  # (T, C, R)
        unknown = np.isnan(residual)
        force = np.einsum("trc,tr->tc", np.linalg.pinv(lever), np.where(unknown, 0.0, residual))
        lost = np.any(unknown[:, None, :] & acts, axis=-1)
        found.append(np.asarray(np.where(lost, np.nan, force / area / BAR)))
    return found


def _end_quantities(found: Diagnosis) -> dict[str, dict[str, float]]:
    question, both = found.evidence.found.question, found.simulated
    return {
        name: {"before": error(question, both.before), "after": error(question, both.after)}
        for name, error in (("payload_kg", weight_error), ("tip_force_n", force_error))
    }


def _total(each: Array) -> float:
    return float(np.sqrt(np.mean(each**2)))


def _known(value: float) -> float | None:
    return value if np.isfinite(value) else None


# Causes


def _effect(named: Named, found: Diagnosis) -> dict[str, Any]:
    cause, both = named.cause, found.simulated
    value, low, high = cause.interval
    simulated = _simulated(found)
    closure, lowest, highest = both.share if simulated else (np.nan, np.nan, np.nan)
    return {
        "name": cause.proposal.name,
        "at": cause.proposal.at,
        "when": cause.when,
        "parameters": {"size": {"value": value, "low": low, "high": high, "unit": cause.proposal.about.unit}},
        "shape": cause.proposal.shape,
        "confidence": named.confidence,
        "confused_with": [_place(key) for key in named.rivals],
        "same_as": [_place(named.same_as)] if named.same_as else [],
        "closure": {"value": _known(closure), "low": _known(lowest), "high": _known(highest)},
        "share": named.share,
        "removed_nm": both.removed * float(np.sqrt(named.share)) if simulated else None,
        "evidence_nats": cause.nats,
    }


def _place(key: Key) -> dict[str, Any]:
    return {"name": key[0], "at": key[1]}


def _reason(found: Diagnosis) -> str:
    """Return why no cause can be named."""
    question = found.evidence.found.question
    source = question.machine.source
    if found.parameters_first:
        return BECAUSE[source]
    if found.evidence.found.work is None:
        at = " and ".join(dict.fromkeys(spot.joint for spot in found.spots if spot.found))
        at = f" at the {at}" if at else ""
        of = {KnowledgeSource.IDENTIFICATION: "the identified model's", KnowledgeSource.SIMULATION: "the simulation's"}
        return (
            f"the torques{at} differ from {of.get(source, 'the references')}, but a machine in order may, too: its "
            "recordings differ as much from each other"
        )
    told = [f"{name} at {at}" for name, at in _effects_by_probability(found)][:MOST_LISTED]
    most = f"; the most probable: {', '.join(told)}" if told and source is not KnowledgeSource.IDENTIFICATION else ""
    return f"the machine works in these recordings, with loads and contact of which nothing is known{most}"


def _effects_by_probability(found: Diagnosis) -> list[Key]:
    posterior = found.evidence.posterior
    effects = [key for key, p in posterior.items() if key not in (NO_GAP, UNKNOWN) and p > 0.0]
    return sorted(effects, key=lambda key: -posterior[key])


def _probabilities(found: Diagnosis) -> dict[str, Any]:
    """Return the probabilities of no gap, of each effect at its location, and of a cause that the library lacks."""
    posterior = found.evidence.posterior
    return {
        "no_gap": posterior.get(NO_GAP, 0.0),
        "unknown": posterior.get(UNKNOWN, 0.0),
        "effects": [_place(key) | {"probability": posterior[key]} for key in _effects_by_probability(found)],
    }


def _evidence(found: Diagnosis) -> list[dict[str, Any]]:
    """Return the candidates with most evidence, each by itself."""
    evidence = found.evidence
    none = evidence.found.healthy.log
    alone = sorted(evidence.alone.items(), key=lambda item: -item[1])
    known = [(key, log) for key, log in alone if key != UNKNOWN]
    probability = evidence.posterior
    return [
        _place(key) | {"nats": log - none, "probability": probability.get(key, 0.0)}
        for key, log in known[:MOST_EVIDENCE]
    ]


def _hidden(found: Diagnosis) -> list[dict[str, Any]]:
    """Return effects that would have to be implausibly large to be detected in these recordings."""
    largest = {form.key: form.high for form in found.evidence.found.question.forms}
    return [
        _place(key) | {"smallest_detectable": _known(size)}
        for key, size in smallest_detectable(found.evidence.found).items()
        if key[0] != UNKNOWN[0] and size > largest[key] / 2.0
    ]


def _next(found: Diagnosis, hidden: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the checks by hand of the causes and their rivals."""
    about = {(p.name, p.at): p.about for p in found.evidence.found.question.machine.layout.proposals}
    wanted = [named.cause.proposal.about.confirm for named in found.named]
    wanted += [about[key].confirm for named in found.named for key in named.rivals if key in about]
    return list(dict.fromkeys(wanted)) if wanted or not hidden else [LONGER]
