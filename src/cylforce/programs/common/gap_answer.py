"""The answer as plain values, stable and documented: what `cylforce gap --json` writes."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from cylforce.diagnosis.answer.causes import WIDE, Cause, Suspect, interval
from cylforce.diagnosis.answer.shrinkage import Gap, written
from cylforce.diagnosis.answer.verdict import Judged, Named, Search, Verdict
from cylforce.diagnosis.answer.where import Spot
from cylforce.diagnosis.columns.problem import Problem, Seen
from cylforce.diagnosis.inference.posterior import NOTHING, UNKNOWN
from cylforce.diagnosis.inference.residuals import pushed, rms, weighed
from cylforce.diagnosis.recordings.clocks import Slip
from cylforce.effects.incidents.clock_fault import ClockFault
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array
from cylforce.signals.units import BAR

CLOSING = ((Verdict.EXPLAINED, 0.9), (Verdict.PARTLY, 0.7))  # of the energy that a lag takes away, at least
SUREST = 0.99
FEW = 3  # causes of which none stands out, that are told
CONFIRM = {  # whether a shape of what is left is real
    "speed": "move the {at} alone at five speeds, both ways: does it follow the same curve?",
    "position": "move the {at} alone, slowly, thrice through its range and back: does it return at the same angles?",
    "load": "repeat the same moves of the {at} empty and with two known loads: does it grow with the load?",
    "time": "repeat the same moves of the {at} every ten minutes: does it go on changing?",
    "moments": "repeat the moves at which it shows, see the plot of the {at}: does it return?",
}


def answer(search: Search, judged: Judged, gap: Gap, spots: Sequence[Spot], shape: dict[str, Any]) -> dict[str, Any]:
    """The whole answer; SI units. `shape`: of what is left."""
    hidden, unknown = _hidden(search), shape if judged.verdict in (Verdict.UNKNOWN, Verdict.PARTLY) else None
    ends = {"payload_kg": weighed, "tip_force_n": pushed}
    return {
        "verdict": str(judged.verdict),
        "gap": _gap(search, judged._replace(named=()) if search.working else judged, gap),
        "where": [_spot(spot) for spot in spots],
        "effects": [_effect(n, gap) | ({"removed_nm": None} if search.working else {}) for n in judged.named],
        **({"reason": reason(search, spots)} if judged.verdict is Verdict.NOT_OBSERVABLE else {}),
        "small": [_small(cause) for cause in search.causes if cause.known and not _is_named(cause, judged)],
        "explained": None if search.working else judged.explained,
        "working": search.working,
        "end_quantities": None
        if search.working
        else {
            name: {"before": error(search.question, gap.nominal), "after": error(search.question, gap.left)}
            for name, error in ends.items()
        },
        "probabilities": probabilities(search),
        "calibrated": bool(search.original.clean),
        "set": [{"name": name, "at": at} for name, at in search.belief.credible],
        "not_observable": hidden,
        "next_experiment": _next(judged, hidden),
        "evidence": [_candidate(r) for r in search.first[:20]],
        "unknown": unknown,
    }


def _gap(search: Search, judged: Judged, gap: Gap) -> dict[str, Any]:
    """Residual torque, rms [N m], in all and per joint; residual pressure per cylinder."""
    return {
        "units": "N m",
        "fixed": _total(gap.fixed),
        "refit": _total(gap.refit),
        "floor": _total(gap.floor),
        "after": _total(gap.after),
        "parameter_shift": _shifts(search, gap),
        "joints": _joints(search, gap),
        "bar": _bars(search, gap),
        "simulated": [_place(cause, judged) for cause in written(judged)],
    }


def _joints(search: Search, gap: Gap) -> dict[str, dict[str, float]]:
    """Residual torque per joint."""
    names = [search.original.model.machine.links[j].name for j in search.original.model.machine.rows]
    kinds = (gap.fixed, gap.refit, gap.after, gap.floor)
    return {
        name: {"fixed": a, "refit": b, "after": c, "floor": d}
        for name, a, b, c, d in zip(names, *(x.tolist() for x in kinds), strict=True)
    }


def _spot(spot: Spot) -> dict[str, Any]:
    """A joint and a regime in which it differs."""
    return {
        "channel": spot.channel,
        "regime": spot.regime,
        "share": spot.share,
        "p": spot.p,
        "found": spot.found,
        "rms_faulty": spot.faulty,
        "rms_clean": spot.clean,
    }


def _bars(search: Search, gap: Gap) -> dict[str, dict[str, float]]:
    """Per measured cylinder, as pressure on its head side [bar, rms]."""
    problem = search.original
    quiet = (problem.clean, gap.clean)
    if not gap.clean:
        quiet = (problem.faulty, [np.broadcast_to(gap.floor, e.shape) for e in gap.nominal])
    pairs = ((problem.faulty, gap.nominal), (problem.faulty, gap.left), quiet)
    kinds = [rms(bars(problem, *pair)).tolist() for pair in pairs]
    names = [problem.model.machine.cylinders[c].name for c in measured(problem.model.machine)]
    return {name: {"fixed": a, "after": b, "floor": c} for name, a, b, c in zip(names, *kinds, strict=True)}


def measured(machine: Machine) -> list[int]:
    """The cylinders (from 0) whose force is measured and tells a torque."""
    acting = {c for c, span in enumerate(machine.spans) if set(span) & set(machine.rows)}
    return [c for c in sorted(acting) if machine.forces_measured[c]]


def bars(problem: Problem, seen: Sequence[Seen], left: Sequence[Array]) -> list[Array]:
    """Residuals (T, R) [N m] of recordings as pressures (T, C) [bar] on the head side of the measured cylinders, the
    rod side as recorded: N m / lever / area. Where several cylinders move a joint they share it by their levers."""
    machine = problem.model.machine
    return [_pressed(machine, s.rows.posture, e) for s, e in zip(seen, left, strict=True)]


def _pressed(machine: Machine, theta: Array, left: Array) -> Array:
    chosen, rows = measured(machine), list(machine.rows)
    lever = machine.geometry(theta).lever[:, chosen][:, :, rows]  # (T, C, R)
    unknown = np.isnan(left)
    force = np.einsum("trc,tr->tc", np.linalg.pinv(lever), np.where(unknown, 0.0, left))
    acts = np.array([[j in machine.spans[c] for j in rows] for c in chosen])
    lost = np.any(unknown[:, None, :] & acts, axis=-1)
    area = np.array([machine.cylinders[c].area_head for c in chosen])
    return np.asarray(np.where(lost, np.nan, force / area / BAR))


def _place(cause: Cause, judged: Judged) -> dict[str, Any]:
    name, at = cause.key
    return {"name": name, "at": at, "named": _is_named(cause, judged)}


def _is_named(cause: Cause, judged: Judged) -> bool:
    return any(n.cause is cause for n in judged.named)


def reason(search: Search, spots: Sequence[Spot]) -> str:
    """Why no cause can be named, where none is observable."""
    if not search.working:
        at = " and ".join(dict.fromkeys(spot.channel for spot in spots if spot.found))
        at = f" at the {at}" if at else ""
        of = "the references'" if search.original.clean else "the identified model's"
        return f"the torques{at} differ from {of}, but in order may, too, in another motion"
    told = ["{} at {}".format(*c.key) for c in search.first if c.known and c.probability > 0.0][:FEW]
    most = f"; the most probable: {', '.join(told)}" if told and search.original.clean else ""
    return f"the machine works in these recordings, with loads and contact of which nothing is known{most}"


def shifted(answer: dict[str, Any], judged: Judged) -> str:
    """Where nothing is named, whether it is the parameters that do not hold, in a sentence; else nothing."""
    size, (most, *_) = answer["gap"], answer["gap"]["parameter_shift"]
    if judged.verdict is not Verdict.UNKNOWN or size["refit"] > (size["fixed"] + size["floor"]) / 2.0:
        return ""
    return (
        f"with the model's parameters fitted to these recordings {size['refit']:.0f} N m are left ({most['name']} "
        f"changes by {abs(most['standard_errors']):.0f} standard errors): the recording of the identification does not "
        "represent these; identify from a longer one, or give a recording of the machine in order as reference"
    )


def _small(cause: Cause) -> dict[str, Any]:
    name, at = cause.key
    share = cause.size / cause.proposal.about.low
    return {"name": name, "at": at, "of_least_plausible": share, "evidence_nats": cause.nats}


def probabilities(search: Search) -> dict[str, Any]:
    """Of no gap, of each effect at its place, of what the library lacks."""
    of = search.belief.of
    effects = [c for c in search.first if c.known and c.probability > 0.0]
    return {
        "no_gap": of.get(NOTHING, 0.0),
        "unknown": of.get(UNKNOWN, 0.0),
        "effects": [{"name": c.key[0], "at": c.key[1], "probability": c.probability} for c in effects],
    }


def off_clock(slips: Sequence[Slip]) -> tuple[Verdict, dict[str, Any]]:
    """The verdict and the answer where pressures and angles are not on one clock, the largest lag first: nothing else
    can be concluded from what does not belong together."""
    worst = slips[0]
    verdict = next((v for v, least in CLOSING if worst.closed > least), Verdict.UNKNOWN)
    each = [s for k, s in enumerate(slips) if not any({*s.sensors} <= {*larger.sensors} for larger in slips[:k])]
    effects = [] if verdict is Verdict.UNKNOWN else [_clock_fault(slip) for slip in each]
    cure = [ClockFault().about.confirm]
    return verdict, {"verdict": str(verdict), "effects": effects, "reason": apart(slips), "next_experiment": cure}


def apart(slips: Sequence[Slip]) -> str:
    """The sentence that pressures and angles are not on one clock, the largest lag first."""
    worst, names = slips[0], ", ".join(dict.fromkeys(slip.name for slip in slips))
    whose = "the pressures" if worst.whole else f"{' and '.join(worst.sensors)}, and no other pressures,"
    others = "".join(f", or {_late(a)} and {_late(b)}" for a, b in worst.others)
    also = f" (as the motion repeats itself, it may also be{others[4:]})" if others else ""
    return (
        f"pressures and angles are not on one clock in {names}: in {worst.name} {whose} are "
        f"{_late(worst.first)} after {worst.begins:.0f} s and {_late(worst.last)} after {worst.ends:.0f} s{also}. Pair "
        "them by the time at which they were measured, not by their number, and record again"
    )


def _late(lag: float) -> str:
    return f"{abs(lag):.2f} s {'late' if lag >= 0.0 else 'early'}"


def _clock_fault(slip: Slip) -> dict[str, Any]:
    value, error = slip.largest
    about = ClockFault().about
    size = {"value": value, "low": value - WIDE * error, "high": value + WIDE * error, "unit": about.unit}
    return {
        "name": about.name,
        "at": "machine",
        "sensors": list(slip.sensors),
        "when": f"{slip.first:.2f} s at {slip.begins:.0f} s, {slip.last:.2f} s at {slip.ends:.0f} s of {slip.name}",
        "parameters": {"size": size},
        "shape": {},
        "confidence": min(slip.probability, SUREST),
        "confused_with": [],
        "same_as": [],
        "alternatives": [{"first_s": first, "last_s": last} for first, last in slip.others],
    }


def _total(each: Array) -> float:
    return float(np.sqrt(np.mean(each**2)))


def _known(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _shifts(search: Search, gap: Gap) -> list[dict[str, Any]]:
    names = [p.name for p in search.original.model.parameters]
    order = np.argsort(-np.abs(gap.shift))[:5]
    return [{"name": names[k], "standard_errors": float(gap.shift[k])} for k in order.tolist()]


def _effect(named: Named, gap: Gap) -> dict[str, Any]:
    cause = named.cause
    proposal = cause.proposal
    share = named.share
    return {
        "name": proposal.name,
        "at": proposal.at,
        "when": cause.when,
        "parameters": parameters(cause),
        "shape": proposal.shape,
        "confidence": named.confidence,
        "confused_with": [{"name": r.key[0], "at": r.key[1]} for r in named.confused],
        "same_as": [{"name": named.same[0], "at": named.same[1]}] if named.same else [],
        "closure": {"value": _known(gap.closure), "low": _known(gap.low), "high": _known(gap.high)},
        "share": share,
        "removed_nm": gap.removed * float(np.sqrt(share)),
        "evidence_nats": cause.nats,
    }


def parameters(cause: Cause) -> dict[str, dict[str, Any]]:
    """Sizes with their 90 % intervals."""
    value, low, high = interval(cause)
    return {"size": {"value": value, "low": low, "high": high, "unit": cause.proposal.about.unit}}


def _hidden(search: Search) -> list[dict[str, Any]]:
    """Effects that would have to be implausibly large to be seen on these recordings."""
    largest = {(p.name, p.at): p.about.high for p in search.original.proposals}
    return [
        {"name": name, "at": at, "smallest_detectable": size if np.isfinite(size) else None}
        for (name, at), size in search.least.items()
        if name != UNKNOWN[0] and size > largest[name, at] / 2.0
    ]


def confirm(answer: dict[str, Any]) -> list[str]:
    """The experiment that would tell whether a shape is real, or whether a machine in order moves so, too."""
    if answer["verdict"] == Verdict.NOT_OBSERVABLE and not answer["working"]:
        return ["record the machine in order in this very motion, as a reference"]
    unknown = answer["unknown"]
    return [CONFIRM[unknown["of"]].format(at=unknown["at"])] if unknown and unknown["of"] in CONFIRM else []


def _next(judged: Judged, hidden: list[dict[str, Any]]) -> list[str]:
    wanted = [n.cause.proposal.about.confirm for n in judged.named]
    wanted += [r.proposal.about.confirm for n in judged.named for r in n.confused]
    if hidden and not wanted:
        wanted = ["a longer recording that moves every joint both ways, slowly and fast, empty and with a known load"]
    return list(dict.fromkeys(wanted))


def _candidate(candidate: Suspect) -> dict[str, Any]:
    name, at = candidate.key
    return {"name": name, "at": at, "nats": candidate.nats, "probability": candidate.probability}
