"""`cylforce checkup`: recordings one after the other until the check-up ends.

It ends when one cause is certain, when the machine is healthy, when no further motion separates the causes, or when
something else comes first: an identification of the machine, or better references.
"""

import asyncio
import json
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.text import Text

from cylforce.can.bus import BusError
from cylforce.can.clock import now_us
from cylforce.can.opening import open_shared_bus
from cylforce.commissioning.guidance import Guide
from cylforce.diagnosis.decide import Verdict
from cylforce.diagnosis.model import Seen
from cylforce.diagnosis.search import NO_GAP, Key
from cylforce.effects.library import LIBRARY, Group
from cylforce.files.atomic import RecordingError, replacing
from cylforce.files.logfile import LogWriter
from cylforce.files.motion_table import write_motion
from cylforce.mechanics.machine import Machine
from cylforce.programs.common.gap_answer import HEALTHY_MOTION
from cylforce.programs.common.gap_question import Question
from cylforce.programs.common.progress import Watch, progress_bar, silent
from cylforce.programs.common.readings import header_of, model_of
from cylforce.programs.common.statistics_cache import StatisticsCache
from cylforce.programs.experiments.catalogue import STAIRS_S, STILL_S, TOGETHER_S, RecommendedMotion, checkup
from cylforce.programs.experiments.motions import table_of
from cylforce.programs.gap import Diagnosed, diagnose
from cylforce.programs.live.collector import Collector, View
from cylforce.programs.live.messages import configure_messages
from cylforce.programs.live.picture import Screen
from cylforce.programs.live.station import serve
from cylforce.programs.wording.fault_words import fault
from cylforce.programs.wording.inseparable import checks_by_hand, joint_name
from cylforce.programs.wording.plain import percent
from cylforce.readings.zeros import NAME as OFFSET
from cylforce.settings.machine_file import Loaded

CERTAIN = 0.95  # probability of a cause that is named alone, from which on nothing more is recorded; requirement
MOST_SHOWN = 3  # causes of a step
MOST_FURTHER = 3  # motions requested beyond the check-up itself; convention: half an hour in all
TURNING = 0.02  # rad/s, from which on a joint moves; chosen: well above the noise of an angle sensor
ENOUGH = 0.5  # of a motion of the check-up: with less of it, it is requested
LOOK_S = 0.25
GIVE_UP_S = 30.0  # without one whole sample
LONGEST = 4.0  # times the duration of a motion, after which a step without enough motion is given up; chosen
STILL_WORDS = (
    "lower the tool to the ground, stop the engine, move all levers to relieve the lines, and let the machine stand "
    f"for {STILL_S:.0f} seconds"
)


class End(StrEnum):
    """Why a check-up ends, or that it does not."""

    CERTAIN = "certain"
    HEALTHY = "healthy"
    INSEPARABLE = "inseparable"
    NO_MOTION = "no_motion_tells_more"
    IDENTIFY_FIRST = "identify_first"
    REFERENCES = "references_do_not_suffice"
    OPEN = "open"


@dataclass(frozen=True)
class CheckupStep:
    """One recording more.

    recording: its name
    verdict:   of all recordings so far
    causes:    the most probable ones, with their probability
    separates: pairs of causes that the next motion separates
    """

    recording: str
    verdict: str
    causes: tuple[tuple[Key, float], ...]
    separates: tuple[tuple[Key, Key], ...] = ()


@dataclass(frozen=True)
class Checked:
    """Result of a check-up up to its last step.

    steps:       one of each recording
    end:         why it ended
    inseparable: causes that no motion separates
    by_hand:     checks by hand of causes that are still possible
    still_next:  whether the zeros of the pressure sensors are to be read next
    next:        the motion to record next; None: none is needed, or none helps
    found:       the last diagnosis
    """

    steps: tuple[CheckupStep, ...]
    end: End
    inseparable: tuple[Key, ...]
    by_hand: tuple[str, ...]
    still_next: bool
    next: RecommendedMotion | None
    found: Diagnosed


def check_recordings_of(
    loaded: Loaded,
    question: Question,
    library: tuple[Group, ...] = LIBRARY,
    watch: Watch = silent,
    cache: StatisticsCache | None = None,
    show: Callable[[Checked], None] = lambda _: None,
) -> Checked:
    """Diagnose recordings, one more at a time, until it is decided. Raises RecordingError or ValueError, in a sentence.

    question: its field recordings are the steps, in their order
    show:     is called after each step
    """
    if not question.field:
        raise RecordingError("no recording to check: give one or more, or --bus to record them")
    steps, checked = list[CheckupStep](), None
    for count in range(1, len(question.field) + 1):
        own = {path.name for path in (*question.field[:count], *question.healthy)}
        loads = {name: kg for name, kg in question.loads.items() if name in own}
        part = question._replace(field=question.field[:count], loads=loads)
        found = diagnose(loaded, part, library, watch, cache)
        step, checked = concluded(loaded.service.machine, part, found)
        steps.append(step)
        checked = replace(checked, steps=tuple(steps))
        show(checked)
        if checked.end is not End.OPEN:
            break
    if checked is None:
        raise RecordingError("no recording to check")
    return checked


def concluded(machine: Machine, question: Question, found: Diagnosed) -> tuple[CheckupStep, Checked]:
    """Return the step of the last recording, and the result of all recordings."""
    name = question.field[-1].name
    if found.diagnosis is None or found.plan is None:
        return _without_diagnosis(machine, name, found)
    evidence, plan, named = found.diagnosis.evidence, found.plan, found.diagnosis.named
    causes = tuple(sorted(evidence.posterior.items(), key=lambda item: -item[1])[:MOST_SHOWN])
    working = evidence.found.work.names if evidence.found.work else frozenset[str]()
    free = [seen for seen in evidence.found.question.seen if seen.recording.name not in working]
    still_next = question.still is None and _holds_zero(evidence.credible)
    missing = _missing(machine, free, evidence.found.question.machine.regressors.rows_hz)
    following, separates = missing, tuple[tuple[Key, Key], ...]()
    if missing is None and plan.advice:
        best = next((each for each in plan.advice if each.separates), plan.advice[0])
        following, separates = best.motion, best.separates
    elif plan.advice:
        separates = plan.advice[0].separates
    end = End.OPEN
    nothing_more = missing is None and not plan.advice
    if found.diagnosis.verdict is Verdict.NO_GAP and (evidence.posterior[NO_GAP] >= CERTAIN or nothing_more):
        end = End.HEALTHY
    elif found.diagnosis.parameters_first:
        end = End.IDENTIFY_FIRST
    elif found.diagnosis.verdict is Verdict.NOT_OBSERVABLE and not working:
        end = End.REFERENCES
    elif len(named) and not named[0].rivals and named[0].confidence >= CERTAIN and _alone(found):
        end = End.CERTAIN
    elif nothing_more and not still_next:
        end = End.INSEPARABLE if plan.inseparable else End.NO_MOTION
    step = CheckupStep(name, str(found.diagnosis.verdict), causes, separates)
    open_causes = plan.inseparable if end is End.INSEPARABLE else evidence.credible
    proposals = evidence.found.question.machine.layout.proposals
    by_hand = () if end in (End.HEALTHY, End.CERTAIN, End.REFERENCES) else checks_by_hand(open_causes, proposals)
    is_open = end is End.OPEN
    return step, Checked(
        (step,), end, plan.inseparable, by_hand, is_open and still_next, following if is_open else None, found
    )


def _without_diagnosis(machine: Machine, name: str, found: Diagnosed) -> tuple[CheckupStep, Checked]:
    """Return a step without a plan: wrong clocks, a sensor fault, too little motion, useless references, or a model
    whose parameters come first.
    """
    effects = found.answer.get("effects", [])
    causes = tuple(((each["name"], each["at"]), float(each["confidence"])) for each in effects[:MOST_SHOWN])
    step = CheckupStep(name, found.answer["verdict"], causes)
    end = End.IDENTIFY_FIRST if "identify_first" in found.answer else End.OPEN
    end = End.REFERENCES if found.poor_references else end
    if len(causes) == 1 and causes[0][1] >= CERTAIN and step.verdict == Verdict.EXPLAINED:
        end = End.CERTAIN
    following = checkup(machine)[0] if end is End.OPEN else None
    return step, Checked((step,), end, (), (), False, following, found)


def _alone(found: Diagnosed) -> bool:
    """Return whether the verdict names its first cause as the explanation."""
    return found.diagnosis is not None and found.diagnosis.verdict in (Verdict.EXPLAINED, Verdict.PARTLY)


def _holds_zero(causes: Sequence[Key]) -> bool:
    """Return whether a reading without pressure separates some of the causes."""
    zeros = [key for key in causes if key[0] == OFFSET]
    return len(zeros) > 0 and len(causes) > 1


def _missing(machine: Machine, seen: Sequence[Seen], rows_hz: float) -> RecommendedMotion | None:
    """Return the motion of the check-up that recordings in the air do not hold yet; None: they hold both."""
    together_s = single_s = 0.0
    for each in seen:
        rate = np.abs(np.diff(each.rows.posture, axis=0)) * rows_hz
        moving = np.sum(rate > TURNING, axis=1)
        together_s += float(np.sum(moving > 1)) / rows_hz
        single_s += float(np.sum(moving == 1)) / rows_hz
    together, stairs = checkup(machine)
    if together_s < ENOUGH * TOGETHER_S:
        return together
    return stairs if single_s < ENOUGH * ENOUGH * STAIRS_S else None  # half of the stairs is holding still


# What is printed and written


def line_of(machine: Machine, number: int, checked: Checked) -> str:
    """Return the line of the last step."""
    step = checked.steps[-1]
    causes = "; ".join(f"{fault(machine, *key)} {percent(p)}" for key, p in step.causes)
    apart = "; ".join(f"{fault(machine, *a)} from {fault(machine, *b)}" for a, b in step.separates[:MOST_SHOWN])
    following = f"; the next motion separates {apart}" if apart and checked.end is End.OPEN else ""
    return f"{number} {step.recording}: {causes or step.verdict}{following}"


def sentences_of(machine: Machine, checked: Checked) -> list[str]:
    """Return how the check-up ended, or the next recording to be made."""
    step = checked.steps[-1]
    cure = "" if checked.found.poor_references else f": {HEALTHY_MOTION}"  # else the reason has it
    ends = {
        End.HEALTHY: "no fault: the machine moves as it did while it was healthy",
        End.CERTAIN: "decided: " + "; ".join(fault(machine, *key) for key, _ in step.causes[:1]),
        End.INSEPARABLE: f"no motion separates these, so it is one answer: {joint_name(machine, checked.inseparable)}",
        End.NO_MOTION: "no motion of the catalogue says more about this machine",
        End.IDENTIFY_FIRST: (
            "identify the machine first (cylforce identify): its model's masses and friction are not this machine's"
        ),
        End.REFERENCES: f"the references do not suffice{cure}",
        End.OPEN: "not decided yet",
    }
    found = [ends[checked.end]]
    unsaid = checked.found.diagnosis is None or checked.end is End.REFERENCES
    if unsaid and "reason" in checked.found.answer:
        found.append(checked.found.answer["reason"])
    if checked.end in (End.INSEPARABLE, End.NO_MOTION):
        found += [f"check by hand: {check}" for check in checked.by_hand]
    if checked.end is End.OPEN:
        found += [f"record next: {words} ({option})" for words, option in _next_words(checked)]
    return found


def _next_words(checked: Checked) -> list[tuple[str, str]]:
    found = [(STILL_WORDS, "--still FILE")] if checked.still_next else []
    if checked.next is not None:
        stop = checked.found.plan is not None and checked.found.plan.stop_first
        words = f"stop working, and {checked.next.words}" if stop else checked.next.words
        found.append((words, "one more recording"))
    return found


def answer_of(machine: Machine, checked: Checked) -> dict[str, Any]:
    """Return the check-up as plain values, for JSON."""
    return {
        "end": str(checked.end),
        "steps": [
            {
                "recording": step.recording,
                "verdict": step.verdict,
                "causes": [{"name": name, "at": at, "probability": p} for (name, at), p in step.causes],
                "separates": [[{"name": n, "at": at} for n, at in pair] for pair in step.separates],
            }
            for step in checked.steps
        ],
        "inseparable": [{"name": name, "at": at} for name, at in checked.inseparable],
        "joint_name": joint_name(machine, checked.inseparable) or None,
        "check_by_hand": list(checked.by_hand),
        "record_next": [words for words, _ in _next_words(checked)],
        "answer": checked.found.answer,
    }


@dataclass(frozen=True)
class CheckupOutputs:
    """Files to be written; None: not written.

    answer: the check-up as JSON
    motion: the motion to record next as a table
    """

    answer: Path | None = None
    motion: Path | None = None


def run_checkup(
    loaded: Loaded, question: Question, outputs: CheckupOutputs, console: Console, cache: StatisticsCache | None = None
) -> Checked:
    """Check recordings, print a line of each, write the output files.

    Raises RecordingError or ValueError, in a sentence.
    """
    machine = loaded.service.machine

    def show(checked: Checked) -> None:
        console.print(Text(line_of(machine, len(checked.steps), checked)), soft_wrap=True)

    with progress_bar() as watch:
        checked = check_recordings_of(loaded, question, watch=watch, cache=cache, show=show)
    _finish(machine, checked, outputs, console)
    return checked


def _finish(machine: Machine, checked: Checked, outputs: CheckupOutputs, console: Console) -> None:
    for sentence in sentences_of(machine, checked):
        console.print(Text(sentence), soft_wrap=True)
    if outputs.answer is not None:
        finite = json.loads(json.dumps(answer_of(machine, checked), default=float), parse_constant=lambda _: None)
        with replacing(outputs.answer) as temporary:
            temporary.write_text(json.dumps(finite, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    if outputs.motion is not None and checked.next is not None:
        write_motion(outputs.motion, table_of(checked.next), [link.name for link in machine.links])


# On the bus


def run_guided(
    loaded: Loaded,
    question: Question,
    bus: str,
    folder: Path,
    outputs: CheckupOutputs,
    console: Console,
    cache: StatisticsCache | None = None,
) -> bool:
    """Guide through the check-up on the bus: record a step, diagnose, until it is decided.

    Return False when it was interrupted; the recordings are kept. Never commands the machine.
    folder: folder of the recordings, still.log, 1.log, 2.log ...
    """
    configure_messages(Path(os.devnull).open("w") if sys.stderr.isatty() else sys.stderr)  # noqa: SIM115
    machine, steps = loaded.service.machine, list[CheckupStep]()
    folder.mkdir(parents=True, exist_ok=True)
    still = folder / "still.log"
    if not _recorded(loaded, bus, still, STILL_WORDS, STILL_S, console, moving=False):
        return False
    question = question._replace(still=still)
    motion, checked = checkup(machine)[0], None
    while len(steps) < len(checkup(machine)) + MOST_FURTHER:
        path = folder / f"{len(steps) + 1}.log"
        if not _recorded(loaded, bus, path, motion.words, motion.scene.duration, console):
            return False
        loads = question.loads | ({path.name: motion.load_kg} if motion.load_kg else {})
        question = question._replace(field=(*question.field, path), loads=loads)
        with progress_bar() as watch:
            step, checked = concluded(machine, question, diagnose(loaded, question, LIBRARY, watch, cache))
        steps.append(step)
        checked = replace(checked, steps=tuple(steps))
        console.print(Text(line_of(machine, len(steps), checked)), soft_wrap=True)
        if checked.end is not End.OPEN or checked.next is None:
            break
        motion = checked.next
    if checked is not None:
        _finish(machine, checked, outputs, console)
    return True


def _recorded(
    loaded: Loaded, bus: str, path: Path, words: str, seconds: float, console: Console, *, moving: bool = True
) -> bool:
    """Record a step from the bus until it has enough motion, or has stood for long enough; False: interrupted."""
    opened = open_shared_bus(bus)
    try:
        writer = LogWriter(path, header_of(loaded, None, bus), now_us(), bus.partition(":")[2])
        console.print(f"recording to {path}", soft_wrap=True)
        collector = Collector(loaded, Guide(model_of(loaded), every_s=np.inf), opened, writer)
        return asyncio.run(_followed(collector, words, seconds, console, moving=moving))
    finally:
        opened.close()


async def _followed(collector: Collector, words: str, seconds: float, console: Console, *, moving: bool) -> bool:
    """Return whether a step has enough motion; False: it was interrupted before."""
    until, whole_s, complete = asyncio.Event(), 0.0, False

    def look() -> None:
        nonlocal whole_s, complete
        collector.think()
        view = collector.view()
        whole_s += LOOK_S if view.deaf_s < 1.0 else 0.0
        done_s = view.advice.seconds if moving else whole_s
        say = _trouble(view) or words
        head = f"{collector.service.machine.name}: {min(done_s, seconds):.0f} of {seconds:.0f} s"
        screen.show(Text(f"{head}\n\n> {say}", style="bold"), head, say)
        if view.deaf_s > GIVE_UP_S and view.advice.seconds == 0.0:
            raise BusError(view.instruction)
        if whole_s > LONGEST * seconds:
            raise ValueError(f"after {whole_s:.0f} s only {done_s:.0f} s of motion: {words}")
        complete = done_s >= seconds
        if complete:
            until.set()

    with Screen(console) as screen:
        try:
            await serve(collector, until, look, LOOK_S)
        finally:
            collector.close()
    if collector.log is not None and collector.log.failure:
        raise RecordingError(collector.log.failure)
    return complete


def _trouble(view: View) -> str | None:
    """Return why nothing is recorded; None while all sensors send."""
    return view.trouble if view.deaf_s > 1.0 else None
