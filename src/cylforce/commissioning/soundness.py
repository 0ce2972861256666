"""Whether identified parameters may go into service: what they leave unexplained, and what has to be checked then."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.commissioning.explained import DOUBTFUL, FAR, LITTLE, NOTHING, Quality
from cylforce.commissioning.repairs import Case, Repair, repairs
from cylforce.estimation.model import Model
from cylforce.signals.kinds import Kind

USUALLY = "machines in order: above 99 %"  # what tools/studies/unexplained.py prints


class Soundness(NamedTuple):
    """`refusal`: a sentence for which nothing should be written, or None; `warnings`: sentences that go with the
    parameters into service."""

    refusal: str | None
    warnings: tuple[str, ...]


def soundness(case: Case, found: Quality, broken: tuple[str, ...]) -> Soundness:
    """The verdict on parameters of which `found` is the quality and `broken` are the physical laws that they break;
    `case`: the model, and the last samples of the recording, on which corrections are tried."""
    rows = _rows(found)
    far = found.distance > FAR
    if not any(np.any(row) for row in rows) and not far:
        return Soundness(None, broken)
    worst, little, unseen = rows
    cylinders = _cylinders(case.model, worst | little | unseen)
    good = repairs(case, cylinders)
    if not good:
        little &= np.nan_to_num(found.explained, nan=1.0) < LITTLE
    check = _what_to_check(case.model, cylinders, good)
    refusals = (*_worse(case.model, found, worst), *_unseen(case.model, unseen))
    warnings = (*_little(case.model, found, little), *(_far(found) if far else ()))
    if not refusals and not warnings:
        return Soundness(None, broken)
    first, *others = (*refusals, *warnings)
    sentences = (f"{first}: {check}", *others)
    if refusals:
        return Soundness("; ".join(sentences), ("; ".join(sentences), *broken))
    return Soundness(None, (*sentences, *broken))


Which = NDArray[np.bool_]


def _rows(found: Quality) -> tuple[Which, Which, Which]:
    """Rows (R,) that are worse explained than by a constant, perhaps too little explained, never seen."""
    share = np.nan_to_num(found.explained, nan=1.0)
    worst = share < NOTHING
    return worst, (share < DOUBTFUL) & ~worst, np.array(found.unseen, dtype=bool)


def _names(model: Model, which: Which) -> list[str]:
    return [model.machine.links[j].name for j, chosen in zip(model.machine.rows, which, strict=True) if chosen]


def _shares(model: Model, found: Quality, which: Which) -> str:
    shares = (f"{100.0 * share:.1f} %" for share in found.explained[which])
    return ", ".join(f"{name} {share}" for name, share in zip(_names(model, which), shares, strict=True))


def _worse(model: Model, found: Quality, which: Which) -> tuple[str, ...]:
    if not np.any(which):
        return ()
    joints = " and ".join(_names(model, which))
    text = f"the measured torque of {joints} does not fit the machine file: a constant would explain it better"
    return (f"{text} (explained: {_shares(model, found, which)}; {USUALLY})",)


def _unseen(model: Model, which: Which) -> tuple[str, ...]:
    return tuple(
        f"{name} moved, but by the machine file its cylinder stood beyond an end stop, at a dead point or without a "
        "lever all the time"
        for name in _names(model, which)
    )


def _little(model: Model, found: Quality, which: Which) -> tuple[str, ...]:
    if not np.any(which):
        return ()
    return (f"too little of the measured torque is explained: {_shares(model, found, which)} ({USUALLY})",)


def _far(found: Quality) -> tuple[str, ...]:
    name, errors = found.farthest
    text = "the identified masses lie far from the data sheet, above all"
    return (f"{text} {name}, by {abs(errors):.0f} of its standard errors",)


def _cylinders(model: Model, which: Which) -> list[int]:
    """The cylinders that act on the chosen rows; all when none is chosen."""
    rows = [r for r, chosen in enumerate(which) if chosen] or list(range(len(which)))
    return sorted({c for r in rows for c in model.acting[r]})


def _what_to_check(model: Model, cylinders: list[int], good: tuple[Repair, ...]) -> str:
    """The end of a sentence about joints on which `cylinders` act: the corrections `good`, which make the recording
    fit; without any, what to check, the likeliest first."""
    if good:
        return f"the recording fits with {', or with '.join(repair.words for repair in good)}; check that first"
    return f"no single correction makes the recording fit; check in this order {_all_to_check(model, cylinders)}"


def _all_to_check(model: Model, cylinders: list[int]) -> str:
    machine = model.machine
    names = " and ".join(machine.cylinders[c].name for c in cylinders)
    sensors = [s.name for s in machine.signals if s.kind in (Kind.HEAD_PRESSURE, Kind.ROD_PRESSURE, Kind.FORCE_PIN)]
    angles = [s.name for s in machine.signals if s.kind in (Kind.JOINT_ANGLE, Kind.LINK_INCLINATION)]
    return (
        f"the pins of the {names} cylinder, which side of which cylinder each of {', '.join(sensors)} is on, bore_mm, "
        f"rod_mm and count of {names}, sign and zero of {', '.join(angles) or 'the cylinder lengths'}, the links' "
        "length_m and masses"
    )
