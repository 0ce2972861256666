"""Decide whether identified parameters may go into service: refuse or warn by their residual, with a
cure.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.commissioning.explained import DOUBTFUL, FAR, LITTLE, NOTHING, Quality
from cylforce.commissioning.repairs import Case, Repair, repairs
from cylforce.estimation.model import Model
from cylforce.signals.kinds import Kind

HEALTHY_SHARE = "healthy machines: above 99 %"  # what tools/studies/unexplained.py prints


class Soundness(NamedTuple):
    """Verdict on identified parameters.

    refusal: a sentence why the parameters must not be written, or None
    warnings: sentences that go with the parameters into service, among them the refusal
    """

    refusal: str | None
    warnings: tuple[str, ...]


def soundness(case: Case, fit_quality: Quality, broken: tuple[str, ...]) -> Soundness:
    """Return the verdict on identified parameters.

    They are refused where a constant would explain the torque of a joint better, or a joint moved and no sample of it
    is usable. Too small an explained share, a large distance from the data sheet and broken physical laws are warnings.

    case: the model, and the last samples of the recording, on which corrections are tried
    fit_quality: shares of the torque that the fit explains, and distance of the parameters from the data sheet
    broken: sentences of the physical laws that the parameters break
    """
    rows = _rows(fit_quality)
    far = fit_quality.distance > FAR
    if not any(np.any(row) for row in rows) and not far:
        return Soundness(None, broken)
    worse, little, unseen = rows  # joints worse than a constant, too little explained, never with a usable cylinder
    cylinders = _cylinders(case.model, worse | little | unseen)
    good = repairs(case, cylinders)
    if not good:  # below DOUBTFUL a joint is suspected only together with a correction that explains it better
        little &= np.nan_to_num(fit_quality.explained, nan=1.0) < LITTLE
    check = _what_to_check(case.model, cylinders, good)
    refusals = (*_worse(case.model, fit_quality, worse), *_unseen(case.model, unseen))
    warnings = (*_little(case.model, fit_quality, little), *(_far(fit_quality) if far else ()))
    if not refusals and not warnings:
        return Soundness(None, broken)
    first, *others = (*refusals, *warnings)
    sentences = (f"{first}: {check}", *others)
    if refusals:
        return Soundness("; ".join(sentences), ("; ".join(sentences), *broken))
    return Soundness(None, (*sentences, *broken))


Which = NDArray[np.bool_]  # (R,) which of the measured joints are selected


def _rows(fit_quality: Quality) -> tuple[Which, Which, Which]:
    """Return three masks (R,) of measured joints: worse explained than by a constant, too little explained, unseen.

    Too little: above a constant, but below DOUBTFUL. Unseen: the joint moved, but never with a usable cylinder.
    """
    share = np.nan_to_num(fit_quality.explained, nan=1.0)
    worse = share < NOTHING
    return worse, (share < DOUBTFUL) & ~worse, np.array(fit_quality.unseen, dtype=bool)


def _names(model: Model, which: Which) -> list[str]:
    """Return the names of the links of the selected joints."""
    return [model.machine.links[j].name for j, chosen in zip(model.machine.rows, which, strict=True) if chosen]


def _shares(model: Model, fit_quality: Quality, which: Which) -> str:
    """Return the selected joints with the share of their torque that is explained."""
    shares = (f"{100.0 * share:.1f} %" for share in fit_quality.explained[which])
    return ", ".join(f"{name} {share}" for name, share in zip(_names(model, which), shares, strict=True))


def _worse(model: Model, fit_quality: Quality, which: Which) -> tuple[str, ...]:
    """Return a sentence about the selected joints, whose torque a constant would explain better; () without any."""
    if not np.any(which):
        return ()
    joints = " and ".join(_names(model, which))
    text = f"the measured torque of {joints} does not fit the machine file: a constant would explain it better"
    return (f"{text} (explained: {_shares(model, fit_quality, which)}; {HEALTHY_SHARE})",)


def _unseen(model: Model, which: Which) -> tuple[str, ...]:
    """Return a sentence for each selected joint: it moved without a usable cylinder."""
    return tuple(
        f"{name} moved, but by the machine file its cylinder stood beyond an end stop, at a dead point or without a "
        "lever all the time"
        for name in _names(model, which)
    )


def _little(model: Model, fit_quality: Quality, which: Which) -> tuple[str, ...]:
    """Return a sentence with the shares of the joints of whose torque too little is explained; () without any.

    which: (R,) True for these joints
    """
    if not np.any(which):
        return ()
    return (f"too little of the measured torque is explained: {_shares(model, fit_quality, which)} ({HEALTHY_SHARE})",)


def _far(fit_quality: Quality) -> tuple[str, ...]:
    """Return a sentence about the parameter that is farthest from the data sheet."""
    name, errors = fit_quality.farthest
    text = "the identified masses lie far from the data sheet, above all"
    return (f"{text} {name}, by {abs(errors):.0f} of its standard errors",)


def _cylinders(model: Model, which: Which) -> list[int]:
    """Return the numbers of the cylinders that act on the selected joints; of all when none is selected."""
    rows = [r for r, chosen in enumerate(which) if chosen] or list(range(len(which)))
    return sorted({c for r in rows for c in model.acting[r]})


def _what_to_check(model: Model, cylinders: list[int], good: tuple[Repair, ...]) -> str:
    """Return the end of a sentence about joints on which `cylinders` act.

    It names the corrections with which the recording fits; without any, the checks, the likeliest first.

    good: corrections with which the recording fits, the best one first
    """
    if good:
        return f"the recording fits with {', or with '.join(repair.words for repair in good)}; check that first"
    return f"no single correction makes the recording fit; check in this order {_all_to_check(model, cylinders)}"


def _all_to_check(model: Model, cylinders: list[int]) -> str:
    """Return all that may be wrong about cylinders, the likeliest first."""
    machine = model.machine
    names = " and ".join(machine.cylinders[c].name for c in cylinders)
    sensors = [s.name for s in machine.signals if s.kind in (Kind.HEAD_PRESSURE, Kind.ROD_PRESSURE, Kind.FORCE_PIN)]
    angles = [s.name for s in machine.signals if s.kind in (Kind.JOINT_ANGLE, Kind.LINK_INCLINATION)]
    return (
        f"the pins of the {names} cylinder, which side of which cylinder each of {', '.join(sensors)} is on, bore_mm, "
        f"rod_mm and count of {names}, sign and zero of {', '.join(angles) or 'the cylinder lengths'}, the links' "
        "length_m and masses"
    )
