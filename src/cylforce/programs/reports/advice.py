"""Advice after an identification, in sentences for a reader at the machine.

Pure; degrees and per cent are for that reader.
"""

from typing import NamedTuple

import numpy as np

from cylforce.commissioning.coverage import Missing, Pace
from cylforce.commissioning.expectation import Expected, cost
from cylforce.commissioning.identification import Identification
from cylforce.estimation.residual import GOOD_ENOUGH
from cylforce.mechanics.machine import Machine
from cylforce.programs.wording.parameter_words import MEANING, UNKNOWN, meaning

MATTERS = (
    0.001  # of the rated payload: a parameter that adds less to the weight's error is not among the next steps; chosen
)
ENOUGH = 0.9  # of the motion that coverage needs, and of the working range; chosen
NOISY = 0.8  # share of noise in the standard error, from which on better tares would not help; chosen
MOST = 5  # details of a step


class Advised(NamedTuple):
    """Next step for the reader.

    text:    the step
    details: lines below it
    """

    text: str
    details: tuple[str, ...] = ()


class Undetermined(NamedTuple):
    """Parameter that the recording does not determine.

    name:    its name
    meaning: its meaning
    mass:    its contribution to the weight's standard error [kg]
    cure:    the cure
    """

    name: str
    meaning: str
    mass: float
    cure: str


def middle(expected: Expected) -> float:
    """Return the median over all postures of a weight's standard error [kg]; infinite where nothing can be weighed."""
    return float(np.median(np.nan_to_num(expected.standard_error, nan=np.inf)))


def gap_sentences(machine: Machine, gaps: tuple[Missing, ...]) -> tuple[str, ...]:
    """Return sentences on missing motion, for a reader at the machine: one for both directions of the same motion."""
    alike: dict[tuple[int, float, float, Pace], list[Missing]] = {}
    for gap in gaps:
        alike.setdefault((gap.joint, gap.low, gap.high, gap.pace), []).append(gap)
    return tuple(_gap_sentence(machine, found) for found in alike.values())


def _gap_sentence(machine: Machine, gaps: list[Missing]) -> str:
    first = gaps[0]
    low, high = np.degrees([first.low, first.high])
    pace = "fast" if first.pace is Pace.FAST else "slowly"
    ways = " and ".join(f"{gap.way.name.lower()} ({gap.seconds:.1f} of {gap.needed:.1f} s)" for gap in gaps)
    return f"{machine.links[first.joint].name} from {low:.0f}° to {high:.0f}°, {pace}, its cylinder {ways}"


def usable_share(machine: Machine, expected: Expected) -> float:
    """Return the share of the working range in which a weight is good enough to be booked."""
    return float(np.mean(np.nan_to_num(expected.standard_error, nan=np.inf) <= GOOD_ENOUGH * machine.rated_payload))


def undetermined(found: Identification, expected: Expected) -> tuple[Undetermined, ...]:
    """Return the parameters that the recording does not determine, the largest contribution first."""
    each = dict(zip(found.tares.names, cost(found.tares, expected), strict=True))
    lost = []
    for name in found.not_identified:
        owner, _, end = name.rpartition(".")
        cure = MEANING.get(end, UNKNOWN)[1].format(owner)
        lost.append(Undetermined(name, meaning(name), float(each[name]), cure))
    return tuple(sorted(lost, key=lambda u: -u.mass))


def next_steps(
    found: Identification, expected: Expected, lost: tuple[Undetermined, ...], gaps: tuple[str, ...], covered: float
) -> tuple[Advised, ...]:
    """Return the next steps, the most important first."""
    machine = found.model.machine
    matter = tuple(f"{u.name} ({u.meaning}, {u.mass:.1f} kg): {u.cure}" for u in lost if matters(machine, u))
    steps = []
    if found.violations:
        steps.append(
            Advised(
                "Identify again with --enforce, and check the data sheet; these physical laws are violated:",
                found.violations,
            )
        )
    if usable_share(machine, expected) < ENOUGH:
        steps.append(Advised(_where_weak(found, expected)))
    if matter:
        steps.append(
            Advised(
                "Record also what this recording does not determine, and identify from both recordings:", matter[:MOST]
            )
        )
    if covered < ENOUGH:
        steps.append(Advised("To be sure in every posture, record also:", gaps[:MOST]))
    if not found.scale_measured:
        error = 100.0 * found.tares.reported_scale_error
        steps.append(
            Advised(
                "Lift a known weight once (--lift, --known-kg), and measure the pins (pins_m): the scale is still the "
                f"data sheet's, +- {error:.1f} % of every weight."
            )
        )
    return tuple(steps)


def matters(machine: Machine, lost: Undetermined) -> bool:
    """Return whether the parameter contributes enough for a sentence."""
    return not lost.mass <= MATTERS * machine.rated_payload


def _where_weak(found: Identification, expected: Expected) -> str:
    """Return a sentence why the weight is not good enough everywhere: the rows' noise or the tares."""
    known = np.isfinite(expected.standard_error)
    if not np.any(known):
        return "With these tares no weight is good enough anywhere: see below what the recording does not determine."
    if np.median(expected.noise[known]) > NOISY * np.median(expected.standard_error[known]):
        return "Three seconds are too short to weigh in all postures: weigh longer, or where the map below is green."
    worst = ", ".join(found.tares.names[k] for k in np.argsort(-cost(found.tares, expected))[:3])
    return f"The tares are not known well enough to weigh in all postures (map below), above all {worst}."
