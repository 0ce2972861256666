"""Whether what the field is compared with tells what is usual: a reference that is long and varied enough, parameters
that hold."""

from typing import Any

import numpy as np

from cylforce.diagnosis.diagnosis import Search
from cylforce.diagnosis.verdict import Judged, Verdict

SHORT = 2.0  # times the energy of a part that is fitted with the rest, left of one that is predicted by the rest
ALIKE = 1.25  # times the energy of a fitted part: what is left with all causes taken out is as usual


def doubt(search: Search) -> str:
    """What is wrong with the clean recordings, in a sentence; nothing, if nothing is or there are none."""
    fitted, predicted, _ = _per_row(search)
    if not predicted > SHORT * fitted:
        return ""
    return (
        "the reference is too short or too uniform to tell what is usual (a part of it that the rest has to predict "
        f"leaves {predicted / fitted:.0f} times the energy of one that is fitted): record the machine in order for "
        "four minutes, every joint both ways, slowly and fast, and with a known load besides"
    )


def hidden(search: Search) -> bool:
    """Whether such a reference leaves nothing to conclude: no cause, or more left beside the causes than it leaves."""
    fitted, _, left = _per_row(search)
    return not search.causes or left > ALIKE * fitted


def shifted(answer: dict[str, Any], judged: Judged) -> str:
    """Where nothing is named, whether it is the parameters that do not hold, in a sentence; else nothing."""
    size = answer["gap"]
    if judged.verdict is not Verdict.UNKNOWN or size["refit"] > (size["fixed"] + size["floor"]) / 2.0:
        return ""
    most = size["parameter_shift"][0]
    return (
        f"with the model's parameters fitted to these recordings {size['refit']:.0f} N m are left ({most['name']} "
        f"changes by {abs(most['standard_errors']):.0f} standard errors): the recording of the identification does not "
        "represent these; identify from a longer one, or give a recording of the machine in order as reference"
    )


def _per_row(search: Search) -> tuple[float, float, float]:
    """Energy per row that clean parts leave when fitted, and when predicted; what the faulty ones leave with all
    causes."""
    rows, faulty = float(np.sum(search.blocks.clean_rows)), float(np.sum(search.blocks.faulty_rows))
    if not rows or not faulty:
        return np.inf, 0.0, 0.0
    energy = search.energy
    return (
        float(np.sum(energy.clean)) / rows,
        float(np.sum(energy.floor)) / faulty,
        float(np.sum(energy.after)) / faulty,
    )
