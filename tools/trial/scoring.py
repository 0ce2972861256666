"""Pure functions of labels and answers: how good the diagnosis was. A share comes with its count, for its interval."""

from collections.abc import Iterable, Sequence

import numpy as np

from .judged import Judged, Record, Share, place, share
from .probability import brier, brier_skill, calibration_error, log_score, stated

SURE = 0.8  # of a name that must not be given: its effect was taken out of the library


def shares(cases: Sequence[Judged]) -> dict[str, Share]:
    """Every figure that is a share of cases. With the data sheet alone no effect can be named: such cases count only
    where something wrong may be said, and as those that are to be identified first."""
    kinds = ("known", "none", "foreign", "pair", "poor", "without")
    of = {kind: [c for c in cases if c.kind == kind] for kind in kinds}
    known = [c for c in of["known"] if c.has_model]
    visible = [c for c in known if c.visible]
    pairs = [c for c in of["pair"] if c.has_model]
    clean = [c for c in known if not c.label["clutter"] and c.detected]
    clutter = [c for c in known if c.label["clutter"] and c.detected]
    detected = [c for c in known if c.detected]
    return {
        "detected": share(visible, lambda c: c.detected),
        "top1_clean": share(clean, lambda c: c.right),
        "top1_clutter": share(clutter, lambda c: c.right),
        "precision": share([c for c in known if c.one], lambda c: not c.wrong),
        "named_share": share(detected, lambda c: c.one),
        "false_alarms": share(of["none"], lambda c: c.alarm),
        "order_digging": share([c for c in of["none"] if c.digging], lambda c: c.alarm),
        "harsh_alarms": share([c for c in of["none"] if c.label.get("harsh")], lambda c: c.alarm),
        "sure_wrong": share([c for c in cases if c.kind != "without"], lambda c: c.wrong and sure(c)),
        "joint": share([c for c in visible if c.named], lambda c: c.joint_right),
        "foreign_named": share(of["foreign"], lambda c: c.wrong),
        "foreign_alone": share([c for c in of["foreign"] if c.visible], lambda c: c.one and c.wrong),
        "unknown_recall": share(
            [c for c in of["foreign"] if c.visible and c.has_model], lambda c: c.answer["verdict"] == "unknown"
        ),
        "first": share([c for c in visible if not c.digging], lambda c: c.right),
        "dig_first": share([c for c in visible if c.digging], lambda c: c.right),
        "in_set": share(visible, lambda c: bool(c.truth & c.possible)),
        "set_coverage": share([c for c in known if c.named], lambda c: bool(c.truth & (c.possible | c.listed))),
        "pairs_in_set": share(pairs, lambda c: c.named and c.covered),
        "pairs_exact": share(pairs, lambda c: c.named and c.listed == c.truth),
        "pairs_exact_visible": share([c for c in pairs if c.visible], lambda c: c.named and c.listed == c.truth),
        "identify_first": share(
            [c for c in cases if not c.has_model and c.kind not in ("poor", "without")],
            lambda c: "identify_first" in c.answer,
        ),
        "leave_one_out_named": share(of["without"], sure),
        "poor_wrong": share(of["poor"], lambda c: c.named and not c.present & c.listed),
        "closure_coverage": share(_closures(cases), _within),
    }


def sure(case: Judged) -> bool:
    """Whether a name is given with confidence."""
    return case.named and case.confidence >= SURE


def figures(cases: Sequence[Judged]) -> dict[str, float | None]:
    """Every figure that is no share."""
    sizes = [len(c.possible) for c in cases if c.kind == "known" and c.detected]
    errors = [abs(_closure(c)["value"] - c.label["closure"]) for c in _closures(cases)]
    return {
        "set_size": float(np.mean(sizes)) if sizes else None,
        "closure_error_median": float(np.median(errors)) if errors else None,
        "closure_error_p90": float(np.quantile(errors, 0.9)) if errors else None,
        "payload_ratio": payload_ratio(cases),
        "ece": calibration_error(stated(cases)),
        "brier": brier(stated(cases)),
        "brier_skill": brier_skill(stated(cases)),
        "log_score": log_score(cases),
        "cases": float(sum(c.kind != "without" for c in cases)),
    }


def _closure(case: Judged) -> Record:
    return dict(case.effects[0].get("closure") or {})


def _closures(cases: Iterable[Judged]) -> list[Judged]:
    """Cases in which a name came with a closure, and the true closure is known: with references. Without them the gap
    is all that the data sheet lacks, of which the hidden effect is a small part."""
    each = [c for c in cases if c.named and c.has_model]
    return [c for c in each if c.label.get("closure") is not None and _closure(c).get("value") is not None]


def _within(case: Judged) -> bool:
    stated = _closure(case)
    return bool(stated["low"] <= case.label["closure"] <= stated["high"])


def payload_ratio(cases: Iterable[Judged]) -> float | None:
    """Rms error of the payload after the correction over that after the oracle's, of named known effects."""
    pairs = [
        (after, oracle)
        for c in cases
        if c.kind == "known"
        and c.named
        and (after := _payload(c.answer)) is not None
        and (oracle := c.label.get("oracle_payload_kg")) is not None
    ]
    if not pairs:
        return None
    squares = np.mean(np.square(np.array(pairs, dtype=np.float64)), axis=0)
    return float(np.sqrt(squares[0] / squares[1])) if squares[1] > 0.0 else None


def _payload(answer: Record) -> float | None:
    found = ((answer.get("end_quantities") or {}).get("payload_kg") or {}).get("after")
    return None if found is None else float(found)


def true_closure(difference: np.ndarray, before: np.ndarray, after: np.ndarray, level: np.ndarray) -> float | None:
    """Share of the effect's true energy that the correction takes away: 1 - sum((d - (before - after))^2) / sum(d^2).

    All (T, R) [N m], weighted by the floor's `level` (R,); d: what the effect adds to the residual, by the twin; NaN
    rows are left out. None if there is no effect."""
    usable = np.isfinite(difference + before + after)
    d, rest = (np.where(usable, x / level, 0.0) for x in (difference, difference - before + after))
    energy = float(np.sum(d * d))
    return 1.0 - float(np.sum(rest * rest)) / energy if energy > 0.0 else None


def baselines(cases: Sequence[Judged]) -> dict[str, Share]:
    """How often the simplest method, the largest evidence by itself, names a detected known effect first."""
    known = [c for c in cases if c.kind == "known" and c.detected and c.answer.get("evidence")]
    return {"largest_evidence": share(known, lambda c: place(_largest(c.answer["evidence"])) in c.truth)}


def _largest(candidates: Sequence[Record]) -> Record:
    return max(candidates, key=lambda candidate: float(candidate["nats"]))
