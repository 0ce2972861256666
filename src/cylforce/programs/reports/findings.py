"""Content of the report in words and numbers: verdicts, next steps, undetermined parameters.

Pure; degrees and per cent are for the reader.
"""

from typing import NamedTuple

import numpy as np

from cylforce.commissioning.coverage import missing, share
from cylforce.commissioning.expectation import Expected, PostureGrid, cost, expected_error, postures
from cylforce.commissioning.explained import LITTLE
from cylforce.commissioning.identification import Identification
from cylforce.estimation.residual import GOOD_ENOUGH
from cylforce.programs.reports.advice import (
    ENOUGH,
    Advised,
    Undetermined,
    gap_sentences,
    matters,
    middle,
    next_steps,
    undetermined,
    usable_share,
)
from cylforce.programs.reports.evidence import Drawn

EXPLAINED = 0.99  # of a joint's torque: healthy machines exceed it (tools/studies/unexplained.py)
MOST_LIMITS = 8


class Card(NamedTuple):
    """Number that is read first.

    title: its name
    value: its value
    note:  a note below it
    good:  whether it is good; else it is to be checked
    bad:   whether it forbids operation
    """

    title: str
    value: str
    note: str
    good: bool
    bad: bool = False


class Row(NamedTuple):
    """Residual of one joint's torque.

    joint:     name of the link
    rms:       of the residual [N m]
    largest:   largest measured torque [N m]
    mass:      payload that one sample of the residual corresponds to [kg]
    explained: share of the torque that is explained
    """

    joint: str
    rms: float
    largest: float
    mass: float
    explained: float

    @property
    def bad(self) -> bool:
        """True where too little of the torque is explained."""
        return self.explained < LITTLE


class ParameterLine(NamedTuple):
    """Line of the table of parameters.

    name:        of the parameter
    unit:        of the parameter
    sheet:       value of the data sheet
    sheet_error: its standard error
    value:       identified value
    error:       its standard error
    determined:  whether the recording determines it
    """

    name: str
    unit: str
    sheet: float
    sheet_error: float
    value: float
    error: float
    determined: bool


class Findings(NamedTuple):
    """Conclusions of an identification.

    cards:        numbers that are read first
    steps:        next steps
    rows:         residuals of the joints
    undetermined: parameters that the recording does not determine
    gaps:         sentences on missing motion
    parameters:   lines of the table
    grid:         postures of the working range
    expected:     error of a weight in these postures
    sheet:        the error before the identification
    limits:       (name, kg) contributions to the error at the median posture, the largest first
    """

    cards: tuple[Card, ...]
    steps: tuple[Advised, ...]
    rows: tuple[Row, ...]
    undetermined: tuple[Undetermined, ...]
    gaps: tuple[str, ...]
    parameters: tuple[ParameterLine, ...]
    grid: PostureGrid
    expected: Expected
    sheet: Expected
    limits: tuple[tuple[str, float], ...]


def findings(found: Identification, shown: Drawn) -> Findings:
    """Return the conclusions from an identification and the motion of its recording."""
    grid = postures(found.model.machine)
    expected = expected_error(found.model, found.tares, grid.theta)
    sheet = expected_error(found.model, found.model.data_sheet, grid.theta)
    lost = undetermined(found, expected)
    gaps = gap_sentences(found.model.machine, missing(shown.plan, shown.seconds))
    return Findings(
        cards=_cards(found, shown, expected, lost),
        steps=next_steps(found, expected, lost, gaps, share(shown.plan, shown.seconds)),
        rows=_rows(found, shown, grid),
        undetermined=lost,
        gaps=gaps,
        parameters=_parameters(found),
        grid=grid,
        expected=expected,
        sheet=sheet,
        limits=_limits(found, expected),
    )


def _cards(found: Identification, shown: Drawn, expected: Expected, lost: tuple[Undetermined, ...]) -> tuple[Card, ...]:
    rated, within = found.model.machine.rated_payload, usable_share(found.model.machine, expected)
    typical, covered, explained = middle(expected), share(shown.plan, shown.seconds), _explained(found)
    matter = [u for u in lost if matters(found.model.machine, u)]
    count, kept = (
        len(found.tares.names),
        "the others hardly affect the weight" if lost and not matter else "by the recording",
    )
    weight = f"{typical:.1f} kg" if np.isfinite(typical) else "no weight"
    return (
        Card(
            "Weighing error",
            weight,
            f"expected, {100 * typical / rated:.2f} % of rated",
            typical <= GOOD_ENOUGH * rated,
        ),
        Card("Can be booked", f"{100 * within:.0f} %", "of the working range", within >= ENOUGH),
        Card(
            "Torque explained",
            f"{100 * explained:.1f} %",
            "at the worst joint",
            explained > EXPLAINED,
            explained < LITTLE,
        ),
        Card(
            "Postures covered", f"{100 * covered:.0f} %", f"{found.seconds:.0f} s of usable motion", covered >= ENOUGH
        ),
        Card("Parameters determined", f"{count - len(lost)} of {count}", kept, not matter),
    )


def _explained(found: Identification) -> float:
    """Return the explained share of the worst joint's torque; 0 for a joint that never moved."""
    return float(np.min(np.nan_to_num(found.explained, nan=0.0)))


def _limits(found: Identification, expected: Expected) -> tuple[tuple[str, float], ...]:
    """Return the contributions to the weight's standard error [kg], the largest first.

    They are unexplained torque, scale and single tares.
    """
    known = np.isfinite(expected.noise)
    if not np.any(known):
        return ()
    each = dict(zip(found.tares.names, map(float, cost(found.tares, expected)), strict=True))
    each |= {"unexplained torque": float(np.median(expected.noise[known]))}
    each |= {"scale": found.tares.scale_error * found.model.machine.rated_payload}
    return tuple(sorted(each.items(), key=lambda item: -item[1])[:MOST_LIMITS])


def _rows(found: Identification, shown: Drawn, grid: PostureGrid) -> tuple[Row, ...]:
    """Return the residual of each joint's torque."""
    machine = found.model.machine
    arms = machine.tool_point(grid.theta).gradient.imag  # torque of a weight at the tool at each joint, per newton
    mass = found.tares.row_error / (9.81 * np.median(np.abs(arms[..., machine.rows]), axis=(0, 1)))
    largest = np.max(np.abs(shown.points.measured), axis=0, initial=0.0, where=np.isfinite(shown.points.measured))
    names = (machine.links[j].name for j in machine.rows)
    columns = (found.tares.row_error, largest, mass, found.explained)
    return tuple(Row(n, *map(float, x)) for n, *x in zip(names, *columns, strict=True))


def _parameters(found: Identification) -> tuple[ParameterLine, ...]:
    prior = found.model.prior
    spread, error = (np.sqrt(np.diag(c)) for c in (prior.covariance, found.tares.covariance))
    return tuple(
        ParameterLine(p.name, p.unit, float(m), float(s), float(v), float(e), p.name not in found.not_identified)
        for p, m, s, v, e in zip(found.model.parameters, prior.mean, spread, found.tares.values, error, strict=True)
    )
