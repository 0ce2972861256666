"""`cylforce gap`: why a machine differs from its model."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from cylforce.diagnosing import Diagnosis, SheetGap, gap_of_sheet
from cylforce.diagnosing import diagnose as diagnosed
from cylforce.diagnosing.constants import BLOCK_ROWS
from cylforce.diagnosing.decide import Verdict
from cylforce.diagnosing.model import Layout, quiet_blocks, with_proposals
from cylforce.diagnosing.recordings import Recording
from cylforce.diagnosing.regressors import Regressors
from cylforce.diagnosing.search import NO_GAP, Incident, Key
from cylforce.effects.incidents.clock_fault import ClockFault as ClockEffect
from cylforce.effects.library import LIBRARY, UNKNOWN, Group, Proposal
from cylforce.estimation.model import Model
from cylforce.files.atomic import RecordingError
from cylforce.programs.common.gap_answer import answer, before_anything, sheet_answer
from cylforce.programs.common.gap_clocks import apart, off_clock
from cylforce.programs.common.gap_machine import ALWAYS, SEED, Groups, known_machine
from cylforce.programs.common.gap_question import Question, check_recordings, only_effect, reduced
from cylforce.programs.common.progress import Watch, silent
from cylforce.programs.common.readings import recorded_segments
from cylforce.programs.common.recorded import SHORTEST_S, Chosen, at_own_rate, chosen
from cylforce.programs.common.statistics_cache import StatisticsCache
from cylforce.programs.experiments.catalogue import STILL_S
from cylforce.programs.experiments.separation import Plan, planned, sentences
from cylforce.programs.wording.fault_words import happening_beside
from cylforce.readings.clocks import ClockFault, clock_faults
from cylforce.readings.constants import CLEAR_GAP
from cylforce.readings.faulty_sensors import faulty_sensors
from cylforce.readings.jumps import jumping_sensors
from cylforce.readings.noise import noise_warning, sensor_noise, usual_noise
from cylforce.readings.outliers import References
from cylforce.readings.recording import names_of
from cylforce.readings.zeros import Zeros, read_zeros
from cylforce.readings.vibration import vibration_warning, vibrations
from cylforce.settings.machine_file import Loaded

MOVING_S = 20.0  # of usable rows of any joint, below which nothing is concluded
CLOCKS = ClockEffect().about.name
STEPS = 10  # of a diagnosis after reading its recordings, each of which is one more


@dataclass(frozen=True)
class Diagnosed:
    """A diagnosis with its answer.

    answer:    as JSON has it
    diagnosis: None where nothing could be concluded, and where only a data sheet is known
    sheet:     the gap of a machine of which only the data sheet is known, else None
    plan:      what to record next; None where nothing could be concluded
    """

    answer: dict[str, Any]
    diagnosis: Diagnosis | None = None
    sheet: SheetGap | None = None
    plan: Plan | None = None


def diagnose(
    loaded: Loaded,
    question: Question,
    library: tuple[Group, ...] = LIBRARY,
    watch: Watch = silent,
    cache: StatisticsCache | None = None,
) -> Diagnosed:
    """Return the diagnosis of recordings. Raises RecordingError or ValueError, in a sentence.

    cache: where what was learnt of references is kept for the next diagnosis
    """
    check_recordings(question)
    left_out = list[str]()
    chosen_library = reduced(library, question.without)
    only = only_effect(chosen_library, question.only, loaded.service.machine)
    loaded, slow = at_own_rate(loaded, (*question.healthy, *question.field))
    read = partial(chosen, loaded, loads=question.loads, watch=watch, tell=left_out.append)
    healthy, field = read(question.healthy), read(question.field)
    run = _Run(loaded, question, chosen_library, only, watch, cache)
    found = run.concluded(field, healthy)
    shares = [each._asdict() for each in (*field.looked_at, *healthy.looked_at)]
    whole = found.answer | ({"looked_at": shares} if "gap" in found.answer else {})
    warnings = [*left_out, *whole.get("warnings", ()), *([slow] if slow and "gap" in whole else [])]
    whole |= {"warnings": warnings} if warnings or "gap" in whole else {}
    return replace(found, answer=whole)


@dataclass(frozen=True)
class _Run:
    """A diagnosis under way.

    loaded:   the machine
    question: what is asked
    library:  effects that may be a cause
    only:     name and place of the one effect that is examined; None: all
    watch:    is called with what is done
    cache:    of what was learnt of references
    """

    loaded: Loaded
    question: Question
    library: tuple[Group, ...]
    only: tuple[str, str] | None
    watch: Watch
    cache: StatisticsCache | None

    @property
    def _model(self) -> Model:
        return Model(self.loaded.service.machine, self.loaded.service.filters, ALWAYS)

    def concluded(self, field: Chosen, healthy: Chosen) -> Diagnosed:
        """Return the answer for stretches of the field and of the healthy machine."""
        model, loaded, question = self._model, self.loaded, self.question
        if reason := _unreadable(model, field, healthy.stretches):
            return _nothing(reason)
        self.watch("clocks", None)
        late, odd = (self._clock_faults(group) for group in (field.stretches, healthy.stretches))
        references = [each for each in healthy.stretches if each.name not in {fault.name for fault in odd}]
        if late and not references:
            return Diagnosed(off_clock([*late, *odd]))
        self.watch("references", None)
        alike = _alike(model, references, healthy.short, field.stretches)
        if question.healthy and not alike.kept and not (question.identified or question.usual):
            return _nothing(f"no reference is left: {'; '.join([*([apart(odd)] if odd else []), *alike.warnings])}")
        moving = _moving_seconds(model, field.stretches)
        if moving < MOVING_S:
            return _nothing(f"only {moving:.0f} s of usable motion: move every joint both ways, slowly and fast")
        groups = Groups(field.stretches, alike.kept)
        known = known_machine(loaded, question, groups, self.library, self.watch, self.cache)
        warnings = [_left_out(odd, others=bool(alike.kept)), *alike.warnings]
        if known is None:
            return self._sheet(field.stretches, warnings, late)
        rng, rate_hz = np.random.default_rng(SEED), loaded.service.filters.rate_hz
        jumps = jumping_sensors(loaded.service.machine, field.stretches, alike.kept, rate_hz)
        jumps = tuple(each for each in jumps if self._wanted(each.proposal))
        zeros = self._zeros()
        machine = with_proposals(known.machine, [each.proposal for each in jumps])
        found = diagnosed(
            machine,
            field.stretches,
            rng,
            self._wanted,
            lambda doing: self.watch(doing, None),
            {each.proposal.where: each.nats for each in jumps},
            zeros.by_signal,
            identified=known.identified or self.only is not None,
        )
        if late and not _named_first(found, CLOCKS):
            return Diagnosed(off_clock(late))
        self.watch("what to record next", None)
        whole = answer(found)
        plan = planned(found.evidence)
        whole["next_experiment"] = [*before_anything(whole), *sentences(plan), *whole["next_experiment"]]
        whole |= _readings(loaded, groups)
        beside = happening_beside(loaded.service.machine, *_beside(found))
        clocks = apart(late) if late else ""
        warnings += [*known.warnings, *zeros.warnings, *found.refuted, beside, clocks, *_reading_warnings(loaded, groups)]
        whole["warnings"] = [text for text in warnings if text]
        return Diagnosed(whole, found, plan=plan)

    def _sheet(self, field: Sequence[Recording], warnings: Sequence[str], late: Sequence[ClockFault]) -> Diagnosed:
        """Return the answer where only a data sheet is known: identify the machine first."""
        self.watch("fitting masses and friction", None)
        service = self.loaded.service
        sheet, noise = Model(service.machine, service.filters, ()), usual_noise(service.machine, field)
        found = gap_of_sheet(sheet, ALWAYS, field, noise, np.random.default_rng(SEED))
        groups = Groups(field, ())
        whole = sheet_answer(found) | _readings(self.loaded, groups)
        whole["next_experiment"] = before_anything(whole)
        clocks = apart(late) if late else ""
        texts = (*warnings, clocks, *_reading_warnings(self.loaded, groups))
        return Diagnosed(whole | {"warnings": [text for text in texts if text]}, sheet=found)

    def _zeros(self) -> Zeros:
        """Return the readings of the pressure sensors without pressure. Raises RecordingError."""
        path = self.question.still
        if path is None:
            return Zeros({})
        parts = list(recorded_segments(self.loaded, path, self.watch))
        seconds = sum(map(len, parts)) / self.loaded.service.filters.rate_hz
        if seconds < STILL_S / 2.0:
            raise RecordingError(f"{path}: has {seconds:.0f} s of samples: record {STILL_S:.0f} s without pressure")
        return read_zeros(self.loaded.service.machine, np.concatenate(parts))

    def _wanted(self, p: Proposal) -> bool:
        """Return whether an effect may be a cause."""
        if self.only is not None:
            name, at = self.only
            return p.name == name and at in ("", p.at)
        return p.name in self._names

    @property
    def _names(self) -> frozenset[str]:
        return frozenset(group[0].about.name for group in self.library) | {UNKNOWN}

    def _clock_faults(self, recordings: Sequence[Recording]) -> Sequence[ClockFault]:
        """Return clock faults, where the library has that effect."""
        if CLOCKS not in self._names:
            return ()
        return clock_faults(Model(self.loaded.service.machine, self.loaded.service.filters, ()), recordings)


def _nothing(reason: str) -> Diagnosed:
    return Diagnosed({"verdict": str(Verdict.NOT_OBSERVABLE), "effects": [], "reason": reason})


def _named_first(found: Diagnosis, name: str) -> bool:
    return bool(found.named) and found.named[0].cause.key[0] == name


def _beside(found: Diagnosis) -> tuple[float, Key | None]:
    """Return for how long [s] something happens beside the likeliest hypothesis, and what; None if it is everyday."""
    evidence = found.evidence
    question, strength = evidence.found.question, evidence.strength
    block_s = BLOCK_ROWS / question.machine.regressors.rows_hz
    best = max(evidence.candidates, key=lambda c: strength * c.log + evidence.prior_of(c))
    if best.hypothesis.forms and best.incident is not None:
        return block_s * float(np.sum(best.incident.sizes > 0.0)), best.incident.key
    alone = [i for i in evidence.incidents if isinstance(i, Incident) and evidence.key_of(i) == NO_GAP]
    first = max(alone, key=lambda i: i.log, default=None)
    healthy = evidence.found.healthy.log
    if first is None or found.verdict is not Verdict.NO_GAP or first.log < healthy:
        return 0.0, None
    return block_s * float(np.sum(first.sizes > 0.0)), None


# Recordings


def _unreadable(model: Model, field: Chosen, references: Sequence[Recording]) -> str:
    """Return why the field cannot be diagnosed; empty if it can."""
    if not field.stretches:
        reasons = [f"; of {name} {why}" for name, why in field.short.items() if why]
        return f"no gapless stretch of {SHORTEST_S:.0f} s in {', '.join(field.short)}{''.join(reasons)}"
    return "; ".join(each.sentence for each in faulty_sensors(model, field.stretches, references))


def _moving_seconds(model: Model, recordings: Sequence[Recording]) -> float:
    """Return the usable motion [s], summed over the joints."""
    regressors = Regressors(model, model.prior.mean)
    rows = sum(int(np.sum(np.isfinite(regressors.rows(each, ()).residual))) for each in recordings)
    return rows / regressors.rows_hz


@dataclass(frozen=True)
class _Alike:
    """References that are alike.

    kept:     recordings that count
    warnings: sentences about the others
    """

    kept: list[Recording]
    warnings: list[str]


def _alike(
    model: Model, recordings: Sequence[Recording], short: Mapping[str, str], field: Sequence[Recording]
) -> _Alike:
    """Return the references whose sensors are sound and that are alike."""
    faulty = faulty_sensors(model, recordings, field)
    kept = [each for each in recordings if each.name not in {sensor.name for sensor in faulty}]
    compared = _Compared.of(model, kept)
    unlike = compared.references.outliers()
    warnings = [
        f"{name} has no gapless stretch of {SHORTEST_S:.0f} s{f' ({why})' if why else ''}: left out of the references"
        for name, why in short.items()
    ]
    warnings += [f"{sensor.sentence}; it is left out of the references" for sensor in faulty]
    warnings += [f"{name} is unlike the other references: left out; what changed between them?" for name in unlike]
    kept = [each for each in kept if each.name not in unlike]
    warnings += _mostly_work(compared, names_of(kept)) or _contradicting(compared, names_of(kept))
    return _Alike(kept, warnings)


@dataclass(frozen=True)
class _Compared:
    """References beside each other.

    references: their products, in the blocks without contact and unknown loads
    total_s:    seconds of each recording, by name
    counted_s:  seconds of these blocks, by name
    """

    references: References
    total_s: Mapping[str, float]
    counted_s: Mapping[str, float]

    @classmethod
    def of(cls, model: Model, recordings: Sequence[Recording]) -> "_Compared":
        """Return recordings compared."""
        regressors, layout = Regressors(model, np.zeros(len(model.parameters))), Layout(model, ())
        rows = [regressors.rows(each, ()) for each in recordings]
        count, load = len(model.parameters), slice(layout.size + 1, layout.size + 4)
        columns, total, counted = [], dict[str, float](), dict[str, float]()
        quiet = quiet_blocks(layout, rows, recordings) if rows else []
        for each, own, kept in zip(recordings, rows, quiet, strict=True):
            whole = layout.columns(own, each)
            centre = whole[..., load] * float(each.load_kg > 0.0)
            on = np.repeat(kept, BLOCK_ROWS)[: len(own.t)]
            torque = np.where(on[:, None, None], whole[..., -1:], np.nan)
            columns.append((each.name, np.concatenate([whole[..., :count], centre, torque], axis=-1)))
            total[each.name] = total.get(each.name, 0.0) + len(on) / regressors.rows_hz
            counted[each.name] = counted.get(each.name, 0.0) + float(np.sum(on)) / regressors.rows_hz
        return cls(References.of(model.prior, columns), total, counted)


def _mostly_work(compared: _Compared, names: Sequence[str]) -> list[str]:
    """Return sentences about references of which nearly all looks like work beside the others."""
    said = []
    for name in names if len(names) > 1 else ():
        total, counted = compared.total_s[name], compared.counted_s[name]
        if counted < SHORTEST_S < total:
            said.append(
                f"of {name} only {counted:.0f} of {total:.0f} s tell of the machine: beside the other references, the "
                "rest looks like contact or unknown loads; if there were none, these references contradict each other"
            )
    return said


def _contradicting(compared: _Compared, names: Sequence[str]) -> list[str]:
    """Return a sentence on two references of which a common fit leaves far more than one of each."""
    references = References(compared.references.prior, {n: compared.references.grams[n] for n in names})
    times = references.contradiction()
    if times < CLEAR_GAP:
        return []
    both = " and ".join(names)
    told = f"{both} contradict each other: at a joint they leave {times:.0f} times as much together as by themselves"
    return [f"{told}; one of them is not in order, or its load is not as said: leave it out, or add another reference"]


def _left_out(odd: Sequence[ClockFault], *, others: bool) -> str:
    """Return the sentence that names references whose clocks are apart; empty without any."""
    names = ", ".join(dict.fromkeys(fault.name for fault in odd))
    compared = "the other references" if others else "the model alone"
    return f"{names} is no reference: {apart(odd)}; the diagnosis compares with {compared}" if odd else ""


def _readings(loaded: Loaded, groups: Groups) -> dict[str, Any]:
    """Return the keys of the answer on the readings themselves, which the filters hide."""
    machine, filters = loaded.service.machine, loaded.service.filters
    noise = sensor_noise(machine, groups.field, groups.healthy)
    lines = vibrations(machine, filters, groups.field, groups.healthy)
    return {"noise": [asdict(each) for each in noise], "vibration": [_listed(asdict(each)) for each in lines]}


def _listed(vibration: dict[str, Any]) -> dict[str, Any]:
    return vibration | {"sensors": list(vibration["sensors"])}


def _reading_warnings(loaded: Loaded, groups: Groups) -> list[str]:
    """Return the warnings on noisy sensors and on vibration."""
    machine, filters = loaded.service.machine, loaded.service.filters
    lines = vibrations(machine, filters, groups.field, groups.healthy)
    noise = sensor_noise(machine, groups.field, groups.healthy)
    return [noise_warning(noise), vibration_warning(lines, filters.rate_hz)]
