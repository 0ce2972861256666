"""Where the model's parameters come before any effect: what the answer of `cylforce gap` says of them."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from cylforce.diagnosis.answer.refit import Refit, is_likelier, of_a_data_sheet, of_references
from cylforce.diagnosis.answer.shrinkage import Gap
from cylforce.diagnosis.answer.verdict import Judged, Search, Verdict
from cylforce.diagnosis.columns.recorded import Recorded
from cylforce.diagnosis.inference.found import Found
from cylforce.diagnosis.inference.posterior import UNKNOWN

MOST = 5  # parameters that the answer lists, as many as `parameter_shift`
IDENTIFY = (
    "identify the machine from its own recordings (cylforce identify MACHINE.toml RECORDING... -o identified.toml), "
    "then diagnose with --identified identified.toml: only what that leaves is a gap"
)
SHEET = "nobody has identified this machine"
OTHER = "the model's masses and friction are not this machine's"


def parameters_first(
    everything: Found,
    search: Search,
    judged: Judged,
    size: Gap,
    recordings: tuple[Sequence[Recorded], Sequence[str]],
) -> Refit | None:
    """Return the refit of the model's parameters where that comes before any effect, else None.

    It does for a data sheet, and where references of another machine or of a simulation have other parameters.
    recordings: the faulty ones; friction laws of a model that is fitted to them
    """
    faulty, laws = recordings
    if search.original.from_sheet:
        return of_a_data_sheet(search.viewer, laws, faulty, size)
    if not search.original.clean or judged.verdict is Verdict.NO_GAP:
        return None
    refit = of_references(everything, search.original.faulty, size)
    return refit if is_likelier(everything, refit) else None


def identify_first(refit: Refit, *, sheet: bool) -> dict[str, Any]:
    """Return the answer's key `identify_first`; `sheet`: nothing but a data sheet is known of the machine."""
    before, after = (float(np.sqrt(np.mean(each**2))) for each in (refit.before, refit.after))
    parameters = [change._asdict() for change in refit.changes[:MOST]]
    because = SHEET if sheet else OTHER
    said = {"because": because, "before_nm": before, "after_nm": after, "share": refit.share, "parameters": parameters}
    return {"identify_first": said} | ({} if sheet else {"reason": because})


def unnamed(search: Search) -> Search:
    """Return the search where the parameters, and no effect, are the explanation."""
    first = tuple(suspect._replace(probability=0.0) for suspect in search.first)
    return search._replace(causes=(), first=first, belief=search.belief._replace(of={UNKNOWN: 1.0}))
