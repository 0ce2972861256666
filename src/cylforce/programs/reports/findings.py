"""What the report says in words and numbers: verdicts, what to do next, what the recording does not determine. Pure;
degrees and per cent are for the reader."""

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

EXPLAINED = 0.99  # of a joint's torque: what machines in order exceed (tools/studies/unexplained.py)
MOST_LIMITS = 8


class Card(NamedTuple):
    """A number that is read first: `good` or to be looked at; `bad`: not to go into service."""

    title: str
    value: str
    note: str
    good: bool
    bad: bool = False


class Row(NamedTuple):
    """What the tares leave of one joint's torque: rms, the largest measured torque [N m], what one sample of it would
    be in a payload [kg], and the share of the torque that is `explained`."""

    joint: str
    rms: float
    largest: float
    mass: float
    explained: float

    @property
    def bad(self) -> bool:
        """Whether too little of the torque is explained."""
        return self.explained < LITTLE


class ParameterLine(NamedTuple):
    """A line of the table: data sheet and identified, each with its standard error; `determined`: determined by the
    recording."""

    name: str
    unit: str
    sheet: float
    sheet_error: float
    value: float
    error: float
    determined: bool


class Findings(NamedTuple):
    """Everything that is concluded; `grid` and `expected` of the working range, `sheet` before the
    identification; `limits`: what limits the weight at the median posture, (name, kg), the gravest first."""

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
    """Conclusions from an identification and what its recording shows."""
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
    """The share of the worst joint's torque that is explained; 0 for a joint that was never seen."""
    return float(np.min(np.nan_to_num(found.explained, nan=0.0)))


def _limits(found: Identification, expected: Expected) -> tuple[tuple[str, float], ...]:
    """What limits the weight, the largest first: unexplained torque, scale, single tares, each with its part of the
    standard error [kg]."""
    known = np.isfinite(expected.noise)
    if not np.any(known):
        return ()
    each = dict(zip(found.tares.names, map(float, cost(found.tares, expected)), strict=True))
    each |= {"unexplained torque": float(np.median(expected.noise[known]))}
    each |= {"scale": found.tares.scale_error * found.model.machine.rated_payload}
    return tuple(sorted(each.items(), key=lambda item: -item[1])[:MOST_LIMITS])


def _rows(found: Identification, shown: Drawn, grid: PostureGrid) -> tuple[Row, ...]:
    """What is left of each row's torque."""
    machine = found.model.machine
    arms = machine.tool_point(grid.theta).gradient.imag  # what a weight at the tool does to each joint
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
