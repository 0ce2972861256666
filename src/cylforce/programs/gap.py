"""`cylforce gap`: why a machine differs from its model."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from cylforce.diagnosis import Diagnosis, SheetGap, gap_of_sheet
from cylforce.diagnosis import diagnose as diagnosed
from cylforce.diagnosis.decide import Verdict
from cylforce.diagnosis.model import with_proposals
from cylforce.diagnosis.regressors import Regressors
from cylforce.diagnosis.search import BlockIncident, Key
from cylforce.effects.incidents.clock_fault import ClockFault as ClockEffect
from cylforce.effects.library import LIBRARY, UNKNOWN, Group, Proposal
from cylforce.estimation.model import Model
from cylforce.files.atomic import RecordingError
from cylforce.programs.common.gap_answer import answer, before_anything, sheet_answer
from cylforce.programs.common.gap_clocks import apart, off_clock
from cylforce.programs.common.gap_machine import (
    ALWAYS,
    MOST_UNEXPLAINED,
    OF_SHEET,
    SEED,
    Groups,
    known_machine,
    unexplained,
)
from cylforce.programs.common.gap_question import Question, check_recordings, only_effect, reduced
from cylforce.programs.common.gap_references import alike
from cylforce.programs.common.progress import Watch, silent
from cylforce.programs.common.readings import recorded_segments
from cylforce.programs.common.recorded import SHORTEST_S, Chosen, at_own_rate, chosen
from cylforce.programs.common.statistics_cache import StatisticsCache
from cylforce.programs.experiments.catalogue import STILL_S
from cylforce.programs.experiments.separation import MotionPlan, planned, sentences
from cylforce.programs.wording.fault_words import happening_beside
from cylforce.readings.clocks import ClockSlip, clock_faults_of_groups
from cylforce.readings.constants import BLOCK_ROWS
from cylforce.readings.faulty_sensors import faulty_sensors
from cylforce.readings.jumps import jumping_sensors
from cylforce.readings.noise import noise_warning, sensor_noise, usual_noise
from cylforce.readings.recording import Recording
from cylforce.readings.vibration import vibration_warning, vibrations
from cylforce.readings.zeros import Zeros, read_zeros
from cylforce.settings.machine_file import Loaded
from cylforce.signals.parallel import ParallelMap, sequential_map

MOVING_S = 20.0  # of usable rows of any joint, below which nothing is concluded
CLOCKS = ClockEffect().about.name
OTHER_TEMPERATURE = (
    "friction of the cylinders or zeros of the pressure sensors differ from the references, as at another temperature "
    "of oil and sensors: nothing is named; if the oil was as warm as then, have cylinders and sensors looked at"
)
STEPS = 9  # of a diagnosis after reading its recordings, each of which is one more


@dataclass(frozen=True)
class Diagnosed:
    """Diagnosis with its answer.

    answer:    as in the JSON file
    diagnosis: None where nothing could be concluded, and where there is only a data sheet
    sheet:     the gap of a machine with only a data sheet, else None
    plan:      plan of the next recordings; None where nothing could be concluded, and before an identification
    poor_references: whether nothing can be concluded because of the references: more recordings do not help
    """

    answer: dict[str, Any]
    diagnosis: Diagnosis | None = None
    sheet: SheetGap | None = None
    plan: MotionPlan | None = None
    poor_references: bool = False


def diagnose(
    loaded: Loaded,
    question: Question,
    library: tuple[Group, ...] = LIBRARY,
    watch: Watch = silent,
    cache: StatisticsCache | None = None,
    parallel_map: ParallelMap = sequential_map,
) -> Diagnosed:
    """Return the diagnosis of recordings. Raises RecordingError or ValueError, in a sentence.

    cache:        statistics of references, kept for the next diagnosis
    parallel_map: maps a function, perhaps in parallel
    """
    check_recordings(question)
    left_out = list[str]()
    chosen_library = reduced(library, question.without)
    only = only_effect(chosen_library, question.only, loaded.service.machine)
    loaded, slow = at_own_rate(loaded, (*question.healthy, *question.field))
    read = partial(chosen, loaded, loads=question.loads, watch=watch, tell=left_out.append)
    healthy, field = read(question.healthy), read(question.field)
    found = _GapRun(loaded, question, chosen_library, only, watch, cache, parallel_map).concluded(field, healthy)
    shares = [each._asdict() for each in (*field.looked_at, *healthy.looked_at)]
    whole = found.answer | ({"looked_at": shares} if "gap" in found.answer else {})
    warnings = [*left_out, *whole.get("warnings", ()), *([slow] if slow and "gap" in whole else [])]
    whole |= {"warnings": warnings} if warnings or "gap" in whole else {}
    return replace(found, answer=whole)


@dataclass(frozen=True)
class _GapRun:
    """Diagnosis in progress.

    loaded:       the machine
    question:     inputs of the diagnosis
    library:      effects that may be a cause
    only:         name and location of the one effect that is examined; None: all
    watch:        receives the progress
    cache:        statistics of references, kept for the next diagnosis
    parallel_map: maps a function, perhaps in parallel
    """

    loaded: Loaded
    question: Question
    library: tuple[Group, ...]
    only: tuple[str, str] | None
    watch: Watch
    cache: StatisticsCache | None
    parallel_map: ParallelMap

    @property
    def _model(self) -> Model:
        return Model(self.loaded.service.machine, self.loaded.service.filters, ALWAYS)

    def concluded(self, field: Chosen, healthy: Chosen) -> Diagnosed:
        """Return the answer for stretches of the field and of the healthy machine."""
        model, question = self._model, self.question
        if reason := _unreadable(model, field, healthy.stretches):
            return _nothing(reason)
        self.watch("clocks", None)
        late, odd = self._clock_faults(field.stretches, healthy.stretches)
        references = [each for each in healthy.stretches if each.name not in {fault.name for fault in odd}]
        if late and not references:
            return Diagnosed(off_clock([*late, *odd]))
        self.watch("references", None)
        same = alike(model, references, healthy.short, field.stretches)
        if question.healthy and not same.kept and not (question.identified or question.usual):
            reasons = "; ".join([*([apart(odd)] if odd else []), *same.warnings])
            return replace(_nothing(f"no reference is left: {reasons}"), poor_references=True)
        moving = _moving_seconds(model, field.stretches)
        if moving < MOVING_S:
            return _nothing(f"only {moving:.0f} s of usable motion: move every joint both ways, slowly and fast")
        warnings = [_left_out(odd, others=bool(same.kept)), *same.warnings]
        return self._compared(Groups(field.stretches, same.kept), warnings, late)

    def _compared(self, groups: Groups, warnings: Sequence[str], late: Sequence[ClockSlip]) -> Diagnosed:
        """Return the answer for recordings without a fault of their own.

        warnings: sentences so far
        late:     clock faults of the field recordings
        """
        loaded = self.loaded
        known = known_machine(loaded, self.question, groups, self.library, self.watch, self.cache, self.parallel_map)
        if known is None:
            return self._sheet(groups.field, warnings, late)
        if groups.healthy and not known.identified:
            left = unexplained(known.machine, groups.healthy)
            if left > MOST_UNEXPLAINED:
                reason = (
                    f"{self._healthy_name} cannot be explained: at every joint {100.0 * left:.0f} % of the torque or "
                    "more is left. They show loads or contact of which nothing is known, or a machine that the machine "
                    "file does not describe: record it empty in the air, every joint slowly and fast"
                )
                return replace(_nothing(reason), poor_references=True)
        rng, rate_hz = np.random.default_rng(SEED), loaded.service.filters.rate_hz
        jumps = jumping_sensors(loaded.service.machine, groups.field, groups.healthy, rate_hz)
        jumps = tuple(each for each in jumps if self._wanted(each.proposal))
        zeros = self._zeros()
        found = diagnosed(
            with_proposals(known.machine, [each.proposal for each in jumps]),
            groups.field,
            rng,
            self._wanted,
            lambda doing: self.watch(doing, None),
            {each.proposal.where: each.nats for each in jumps},
            zeros.by_signal,
            identified=known.identified or self.only is not None,
            parallel_map=self.parallel_map,
        )
        if late and not _named_first(found, CLOCKS):
            return Diagnosed(off_clock(late))
        self.watch("what to record next", None)
        plan = None if found.only_parameters else planned(found.evidence)
        whole = answer(found) | _readings(loaded, groups)
        motions = sentences(plan) if plan else []
        whole["next_experiment"] = [*before_anything(whole), *motions, *whole["next_experiment"]]
        beside = happening_beside(loaded.service.machine, *_beside(found))
        clocks = apart(late) if late else ""
        colder = OTHER_TEMPERATURE if found.other_temperature else ""
        texts = [*warnings, *known.warnings, *zeros.warnings, *found.refuted, colder, beside, clocks]
        texts += _reading_warnings(loaded, groups)
        return Diagnosed(whole | {"warnings": [text for text in texts if text]}, found, plan=plan)

    def _sheet(self, field: Sequence[Recording], warnings: Sequence[str], late: Sequence[ClockSlip]) -> Diagnosed:
        """Return the answer when there is only a data sheet: identify the machine first."""
        self.watch("fitting masses and friction", None)
        service = self.loaded.service
        sheet, noise = Model(service.machine, service.filters, ()), usual_noise(service.machine, field)
        found = gap_of_sheet(sheet, OF_SHEET, field, noise, np.random.default_rng(SEED))
        groups = Groups(field, ())
        whole = sheet_answer(found) | _readings(self.loaded, groups)
        whole["next_experiment"] = before_anything(whole)
        clocks = apart(late) if late else ""
        texts = (*warnings, clocks, *_reading_warnings(self.loaded, groups))
        return Diagnosed(whole | {"warnings": [text for text in texts if text]}, sheet=found)

    @property
    def _healthy_name(self) -> str:
        return "the simulation's recordings" if self.question.simulation else "the references"

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

    def _clock_faults(self, *groups: Sequence[Recording]) -> Sequence[Sequence[ClockSlip]]:
        """Return the clock faults of each group of recordings, where the library has that effect."""
        if CLOCKS not in self._names:
            return [()] * len(groups)
        model = Model(self.loaded.service.machine, self.loaded.service.filters, ())
        return clock_faults_of_groups(model, groups, self.parallel_map)


def _nothing(reason: str) -> Diagnosed:
    return Diagnosed({"verdict": str(Verdict.NOT_OBSERVABLE), "effects": [], "reason": reason})


def _named_first(found: Diagnosis, name: str) -> bool:
    return bool(found.named) and found.named[0].cause.key[0] == name


def _beside(found: Diagnosis) -> tuple[float, Key | None]:
    """Return duration [s] and key of an incident besides the likeliest hypothesis; the key is None of a healthy
    machine's.
    """
    evidence = found.evidence
    question, strength = evidence.found.question, evidence.strength
    block_s = BLOCK_ROWS / question.machine.regressors.rows_hz
    best = max(evidence.candidates, key=lambda c: strength * c.log + evidence.prior_of(c))
    if best.hypothesis.forms and best.incident is not None:
        return block_s * float(np.sum(best.incident.sizes > 0.0)), best.incident.key
    if found.verdict is Verdict.NO_GAP and evidence.is_contact_alone(best):
        left_out = sum(np.count_nonzero(~rows) for rows in best.counted())
        return float(left_out / question.machine.regressors.rows_hz), None
    alone = [i for i in evidence.incidents if isinstance(i, BlockIncident) and evidence.is_transient(i)]
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


def _left_out(odd: Sequence[ClockSlip], *, others: bool) -> str:
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
