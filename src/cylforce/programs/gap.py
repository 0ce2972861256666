"""`cylforce gap`: why a machine differs from its model."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from cylforce.diagnosis.answer.belief import decided
from cylforce.diagnosis.answer.located import insisted, located
from cylforce.diagnosis.answer.shape import unexplained
from cylforce.diagnosis.answer.shrinkage import Gap, gap, tried
from cylforce.diagnosis.answer.verdict import Judged, Search, Verdict, judged, searched
from cylforce.diagnosis.answer.where import where
from cylforce.diagnosis.columns.floor import fitted_tares
from cylforce.diagnosis.columns.problem import Identified
from cylforce.diagnosis.columns.recorded import Recorded
from cylforce.diagnosis.columns.rows import Viewer
from cylforce.diagnosis.inference.found import Found, one_answer
from cylforce.diagnosis.inference.idle import idle
from cylforce.diagnosis.inference.search import examined
from cylforce.diagnosis.numbers import GAP
from cylforce.diagnosis.recordings.clocks import Slip, slips
from cylforce.diagnosis.recordings.shaking import noises, shaking
from cylforce.diagnosis.recordings.strangers import contradiction, strange
from cylforce.diagnosis.recordings.unreadable import unreadable
from cylforce.diagnosis.recordings.vibration import vibrating, vibrations
from cylforce.effects.incidents.clock_fault import ClockFault
from cylforce.effects.library import LIBRARY, Group
from cylforce.estimation.model import FRICTION, Model, Tares
from cylforce.files.atomic import Report
from cylforce.programs.common.gap_answer import answer, apart, confirm, off_clock, shifted
from cylforce.programs.common.gap_question import Question, asked_only, check_recordings, reduced
from cylforce.programs.common.gap_refit import IDENTIFY, identify_first, parameters_first, unnamed
from cylforce.programs.common.progress import Watch, silent
from cylforce.programs.common.recorded import SHORTEST_S, Chosen, at_own_rate, chosen
from cylforce.programs.common.row_cache import KeepingViewer, RowCache
from cylforce.programs.common.usual_file import everyday_of, usual_parameters
from cylforce.programs.experiments.separation import planned, said
from cylforce.programs.wording.fault_words import left_aside
from cylforce.settings.identified import read_identified
from cylforce.settings.machine_file import Loaded
from cylforce.signals.estimate import Array

MOVING_S = 20.0  # of usable rows of any joint, below which nothing is concluded
# Friction laws that the model of a diagnosis has; `stribeck` only where it was identified, since it is also an effect.
ALWAYS = ("coulomb", "viscous", "delay", "load_dependent", "directional")
BELIEVED = 0.01  # of the data sheet's tolerances, where it is all that is known: its errors then count as effects
CLOCKS = ClockFault().about.name
STEPS = 8  # of a diagnosis after reading its recordings, each of which is one more
NONE_SHORT: Mapping[str, str] = {}
SEED = 1  # of the permutations and of the bootstrap


class Diagnosed(NamedTuple):
    """The search, the verdict, the gap's size, and the whole answer as JSON has it."""

    search: Search | None
    judged: Judged
    gap: Gap | None
    answer: dict[str, Any]


def diagnose(
    loaded: Loaded,
    question: Question,
    library: tuple[Group, ...] = LIBRARY,
    watch: Watch = silent,
    kept: RowCache | None = None,
) -> Diagnosed:
    """The diagnosis of recordings; `kept`: where references' rows are kept for the next one. Raises RecordingError or
    ValueError, in a sentence."""
    check_recordings(question)
    told = list[str]()
    found = _diagnosed(loaded, question, library, watch, kept, told.append)
    warnings = [*told, *found.answer.get("warnings", ())]
    return found._replace(answer=found.answer | {"warnings": warnings}) if told else found


def _diagnosed(
    loaded: Loaded, question: Question, library: tuple[Group, ...], watch: Watch, kept: RowCache | None, tell: Report
) -> Diagnosed:
    """Return the diagnosis; `tell` is called with a sentence for each part of a recording that was left out."""
    only = asked_only(library := reduced(library, question.without), question.only, loaded.service.machine)
    loaded, slow = at_own_rate(loaded, (*question.reference, *question.field))
    groups = (question.reference, question.field)
    reference, field = (chosen(loaded, paths, question.loads, watch, tell=tell) for paths in groups)
    clean, faulty = reference.stretches, field.stretches
    model = Model(loaded.service.machine, loaded.service.filters, ALWAYS)
    if reason := _unusable(model, field, clean):
        return _nothing(reason)
    watch("clocks", None)
    late, odd = (_late(loaded, group, library) for group in (faulty, clean))
    clean = [each for each in clean if each.name not in {slip.name for slip in odd}]
    if late and not clean:
        return _off_clock([*late, *odd])
    clean, unlike = _alike(model, clean, reference.short, faulty)
    if question.reference and not clean and not (question.identified or question.usual):
        return _nothing(f"no reference is left: {'; '.join([*map(apart, [odd] if odd else []), *unlike])}")
    own = viewed_by(loaded, question, clean)
    viewer, known = _keeping(own.viewer, loaded, question, kept) if kept is not None else own.viewer, own.known
    rng = np.random.default_rng(SEED)
    usual = _daily(loaded, question)
    everything = examined(viewer, faulty, clean, rng, library, _watched(watch), known, only, usual, own.identified)
    watch("causes", None)
    verdict = judged(everything := one_answer(decided(everything)), found := searched(everything))
    if late and not _by_clock(verdict):
        return _off_clock(late)
    seconds = sum(int(np.sum(np.isfinite(seen.rows.left))) for seen in found.original.faulty) / viewer.rows_hz
    if seconds < MOVING_S:
        return _nothing(f"only {seconds:.0f} s of usable motion: move every joint both ways, slowly and fast")
    watch("locating the gap, simulating the effects", None)
    # An identification of this machine says that its parameters are right: what changed since is an effect.
    fitted = None if only or question.identified else faulty
    found, verdict, size, refuted, whole = _concluded(everything, found, verdict, fitted, rng)
    watch("what to record next", None)
    whole["next_experiment"] = [*_first_of_all(whole), *said(planned(everything, found)), *whole["next_experiment"]]
    whole["looked_at"] = [each._asdict() for each in (*field.looked_at, *reference.looked_at)]
    sensors, shake = _sensors(loaded, faulty, clean)
    aside = left_aside(loaded.service.machine, everything.aside_s, everything.asked.incident)
    moved = "" if clean or "identify_first" in whole else shifted(whole, verdict)
    here = slow, aside, moved, apart(late) if late else "", *shake
    whole["warnings"] = [text for text in (_left_out(odd, bool(clean)), *unlike, refuted, *here) if text]
    return Diagnosed(found, verdict, size, whole | sensors)


class _Concluded(NamedTuple):
    """Conclusion of a diagnosis, once the gap is located and the named causes have been simulated.

    search, verdict, size: as the answer has them
    refuted:               why a cause is not named, in a sentence, or empty
    answer:                the answer so far, as JSON has it
    """

    search: Search
    verdict: Judged
    size: Gap
    refuted: str
    answer: dict[str, Any]


def _concluded(
    everything: Found, search: Search, verdict: Judged, faulty: Sequence[Recorded] | None, rng: np.random.Generator
) -> _Concluded:
    """Return the conclusion; `faulty`: recordings to which the model's parameters may be fitted, None if one effect was
    asked for, or if the machine was identified."""
    spots = where(search.original, (plain := gap(search, (), rng)), rng)
    search, verdict, size, refuted = insisted(everything, tried(search, verdict, rng), plain, spots, rng)
    search, verdict, size = located(search, verdict, size, plain, spots)
    refit = None if faulty is None else parameters_first(everything, search, verdict, size, (faulty, ALWAYS))
    sheet = search.original.from_sheet
    if refit and not sheet:
        search, verdict, size = unnamed(search), Judged(Verdict.NOT_OBSERVABLE, (), 0.0), plain
    whole = answer(search, verdict, size, spots, unexplained(search.original, size.left, size.floor))
    whole |= identify_first(refit, sheet=sheet) if refit else {}
    # What an effect would do to a model with wrong parameters says nothing of that effect.
    return _Concluded(search, verdict, size, "" if refit else refuted, whole)


def _first_of_all(whole: dict[str, Any]) -> list[str]:
    """Return what to do before any other experiment."""
    return [IDENTIFY] if "identify_first" in whole else confirm(whole)


def _daily(loaded: Loaded, question: Question) -> Mapping[str, float]:
    return everyday_of(question.usual, loaded.service.machine)


def _watched(watch: Watch) -> Callable[[str], None]:
    return lambda doing: watch(doing, None)


def _sensors(loaded: Loaded, faulty: Sequence[Recorded], clean: Sequence[Recorded]) -> tuple[dict[str, Any], list[str]]:
    """What is told of the readings themselves, which the filters hide: keys of the answer, and warnings."""
    machine, filters = loaded.service.machine, loaded.service.filters
    noise, lines = noises(machine, faulty, clean), vibrations(machine, filters, faulty, clean)
    told = {
        "noise": [each._asdict() for each in noise],
        "vibration": [each._asdict() | {"sensors": [line._asdict() for line in each.sensors]} for each in lines],
    }
    return told, [shaking(noise), vibrating(lines, filters.rate_hz)]


def _keeping(viewer: Viewer, loaded: Loaded, question: Question, kept: RowCache) -> Viewer:
    """A viewer that keeps the references' rows."""
    names = frozenset(path.name for path in question.reference)
    return KeepingViewer(viewer.model, viewer.tares, kept, names, loaded.sha256)


def _nothing(reason: str) -> Diagnosed:
    verdict = Judged(Verdict.NOT_OBSERVABLE, (), 0.0)
    return Diagnosed(None, verdict, None, {"verdict": str(verdict.verdict), "effects": [], "reason": reason})


def _late(loaded: Loaded, recorded: Sequence[Recorded], library: tuple[Group, ...]) -> Sequence[Slip]:
    """Clocks that are apart, where the library has that effect."""
    if all(group[0].about.name != CLOCKS for group in library):
        return ()
    return slips(Model(loaded.service.machine, loaded.service.filters, ()), recorded)


def _unusable(model: Model, field: Chosen, clean: Sequence[Recorded]) -> str:
    """Why the field cannot be diagnosed; nothing if it can."""
    if not field.stretches:
        reasons = [f"; of {name} {why}" for name, why in field.short.items() if why]
        return f"no gapless stretch of {SHORTEST_S:.0f} s in {', '.join(field.short)}{''.join(reasons)}"
    return "; ".join(each.said for each in unreadable(model, field.stretches, clean))


def _alike(
    model: Model, clean: Sequence[Recorded], short: Mapping[str, str] = NONE_SHORT, beside: Sequence[Recorded] = ()
) -> tuple[list[Recorded], list[str]]:
    """The references that tell of the machine and are alike, and sentences about the others."""
    wrong = unreadable(model, clean, beside)
    kept = idle(model, [each for each in clean if each.name not in {dead.name for dead in wrong}])
    unlike = strange(model, kept)
    said = [
        f"{name} has no gapless stretch of {SHORTEST_S:.0f} s{f' ({why})' if why else ''}: left out of the references"
        for name, why in short.items()
    ]
    said += [f"{dead.said}; it is left out of the references" for dead in wrong]
    said += [f"{name} is unlike the other references: left out; what changed between them?" for name in unlike]
    kept = [each for each in kept if each.name not in unlike]
    return kept, [*said, *(_contradicting(kept, Viewer(model, model.prior.mean).rows_hz) or _apart(model, kept))]


def _contradicting(clean: Sequence[Recorded], rows_hz: float) -> list[str]:
    """Sentences about references of which nearly all looks like work beside the others."""
    said = []
    names = dict.fromkeys(each.name for each in clean)
    for name in names if len(names) > 1 else ():
        counts = [each.counts for each in clean if each.name == name and each.counts is not None]
        total, counted = (sum(int(f(own)) for own in counts) / rows_hz for f in (len, np.sum))
        if counts and counted < SHORTEST_S < total:
            said.append(
                f"of {name} only {counted:.0f} of {total:.0f} s tell of the machine: beside the other references, the "
                "rest looks like contact or unknown loads; if there were none, these references contradict each other"
            )
    return said


def _apart(model: Model, clean: Sequence[Recorded]) -> list[str]:
    """A sentence on two references of which a common fit leaves far more than one of each."""
    times = contradiction(model, clean)
    if times < GAP:
        return []
    names = " and ".join(dict.fromkeys(each.name for each in clean))
    told = f"{names} contradict each other: at a joint they leave {times:.0f} times as much together as by themselves"
    return [f"{told}; one of them is not in order, or its load is not as said: leave it out, or add another reference"]


def _left_out(odd: Sequence[Slip], others: bool) -> str:
    """The sentence that names references whose clocks are apart."""
    names = ", ".join(dict.fromkeys(slip.name for slip in odd))
    compared = "the other references" if others else "the model alone"
    return f"{names} is no reference: {apart(odd)}; the diagnosis compares with {compared}" if odd else ""


def _by_clock(judged: Judged) -> bool:
    """Whether the clocks come first among what is named."""
    return bool(judged.named) and judged.named[0].cause.proposal.clock


def _off_clock(late: Sequence[Slip]) -> Diagnosed:
    verdict, whole = off_clock(late)
    return Diagnosed(None, Judged(verdict, (), late[0].closed), None, whole)


class Viewed(NamedTuple):
    """The model of a diagnosis.

    viewer:     model and tares
    known:      (P,) standard errors of the tares; None: as the references determine them
    identified: accuracy of the identification; None: not identified, or the references determine it
    """

    viewer: Viewer
    known: Array | None
    identified: Identified | None = None


def viewed_by(loaded: Loaded, question: Question, clean: Sequence[Recorded]) -> Viewed:
    """Model and tares: identified ones, else those of the clean recordings, else what is usual for the type, else the
    data sheet, without friction."""
    service = loaded.service
    if question.identified is None and not clean and question.usual is not None:
        typical = Model(service.machine, service.filters, ALWAYS, usual_parameters(question.usual, service.machine))
        return Viewed(Viewer(typical, typical.prior.mean), np.sqrt(np.diag(typical.prior.covariance)))
    if question.identified is None and not clean:
        sheet = Model(service.machine, service.filters, ())
        return Viewed(Viewer(sheet, sheet.prior.mean), BELIEVED * np.sqrt(np.diag(sheet.prior.covariance)))
    if question.identified is None:
        model = Model(service.machine, service.filters, ALWAYS)
        return Viewed(Viewer(model, fitted_tares(model, clean)), None)
    tares = read_identified(question.identified, loaded)
    if not clean:  # laws that the identification did not use are no part of what it left unexplained
        model = Model(service.machine, service.filters, tares.friction)
        identified = Identified(tares.covariance, tares.row_error)
        return Viewed(Viewer(model, tares.values), np.sqrt(np.diag(tares.covariance)), identified)
    laws = tuple(law for law in FRICTION if law in (*ALWAYS, *tares.friction))
    model = Model(service.machine, service.filters, laws)
    return Viewed(Viewer(model, _with_all_laws(model, tares)), None)


def _with_all_laws(model: Model, tares: Tares) -> Array:
    """Return the tares (P,) for a model with all friction laws; absent laws are 0."""
    known = dict(zip(tares.names, tares.values.tolist(), strict=True))
    return np.array([known.get(p.name, 0.0) for p in model.parameters])
