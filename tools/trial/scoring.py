"""Pure functions of (label, answer) pairs: how good the diagnosis was.

A label has `kind`, `clutter`, `effects` [{name, at, sigmas}], `sigmas`; an answer is the diagnosis' JSON. A share comes
with its count, so that `bounds` can give its confidence interval."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import beta

Record = dict[str, Any]
SILENT = ("no_gap", "not_observable")
NAMED = ("explained", "partly_explained", "ambiguous")
CERTAIN = 10.0  # sigma: twice the smallest detectable size
BINS = 5


class Share(NamedTuple):
    """`hits` of `cases`."""

    hits: int
    cases: int

    @property
    def value(self) -> float | None:
        """The share, None of nothing."""
        return self.hits / self.cases if self.cases else None


def bounds(share: Share, confidence: float = 0.95) -> tuple[float, float]:
    """Clopper-Pearson's interval of a share."""
    tail, hits, misses = (1.0 - confidence) / 2.0, share.hits, share.cases - share.hits
    low = float(beta.ppf(tail, hits, misses + 1)) if hits else 0.0
    return low, float(beta.ppf(1.0 - tail, hits + 1, misses)) if misses else 1.0


def share(cases: Iterable["Judged"], holds: Callable[["Judged"], bool]) -> Share:
    """Share of the cases for which something is true."""
    found = [holds(case) for case in cases]
    return Share(sum(found), len(found))


@dataclass(frozen=True)
class Judged:
    """A label and the answer to it."""

    label: Record
    answer: Record

    @property
    def kind(self) -> str:
        """Known, none, foreign, pair or poor."""
        return str(self.label["kind"])

    @property
    def truth(self) -> set[tuple[str, str]]:
        """(name, at) of every effect."""
        return {(e["name"], e["at"]) for e in self.label["effects"]}

    @property
    def effects(self) -> list[Record]:
        """The answer's effects, the likeliest first."""
        return list(self.answer.get("effects") or [])

    @property
    def detected(self) -> bool:
        """Any verdict but no gap and not observable."""
        return self.answer["verdict"] not in SILENT

    @property
    def named(self) -> bool:
        """The answer gives at least one name."""
        return self.answer["verdict"] in NAMED and bool(self.effects)

    @property
    def one(self) -> bool:
        """The answer gives exactly one cause."""
        return self.named and self.answer["verdict"] != "ambiguous" and len(self.effects) == 1

    @property
    def right(self) -> bool:
        """The first effect is a true one, at its place."""
        return bool(self.effects) and place(self.effects[0]) in self.truth

    @property
    def listed(self) -> set[tuple[str, str]]:
        """All effects that the answer leaves possible."""
        found = {place(e) for e in self.effects}
        if self.answer["verdict"] == "ambiguous":
            found = {place(e) for e in self.effects[:1]}
            found |= {place(e) for e in (self.effects[0].get("confused_with") or [])}
        return found

    @property
    def visible(self) -> bool:
        """Every true effect is above twice the smallest detectable size."""
        sizes = [e.get("sigmas", self.label.get("sigmas", 0.0)) or 0.0 for e in self.label["effects"]]
        return bool(sizes) and min(sizes) >= CERTAIN


def place(effect: Record) -> tuple[str, str]:
    """(name, at)."""
    return str(effect["name"]), str(effect["at"])


def shares(cases: Sequence[Judged]) -> dict[str, Share]:
    """Every figure that is a share of cases."""
    of = {kind: [c for c in cases if c.kind == kind] for kind in ("known", "none", "foreign", "pair", "poor")}
    known = of["known"]
    clean = [c for c in known if not c.label["clutter"] and c.detected]
    clutter = [c for c in known if c.label["clutter"] and c.detected]
    detected = [c for c in known if c.detected]
    return {
        "detected": share([c for c in known if c.visible], lambda c: c.detected),
        "top1_clean": share(clean, lambda c: c.right),
        "top1_clutter": share(clutter, lambda c: c.right),
        "precision": share([c for c in known if c.one], lambda c: c.right),
        "named_share": share(detected, lambda c: c.one),
        "false_alarms": share(of["none"], lambda c: c.detected),
        "foreign_named": share(of["foreign"], lambda c: c.named),
        "unknown_recall": share([c for c in of["foreign"] if c.visible], lambda c: c.answer["verdict"] == "unknown"),
        "set_coverage": share([c for c in known if c.named], lambda c: bool(c.truth & c.listed)),
        "pairs_exact": share(of["pair"], lambda c: c.named and c.listed == c.truth),
        "pairs_exact_visible": share([c for c in of["pair"] if c.visible], lambda c: c.named and c.listed == c.truth),
        "poor_wrong": share(of["poor"], lambda c: c.named and not c.truth & c.listed),
        "closure_coverage": share(_closures(cases), _within),
    }


def figures(cases: Sequence[Judged]) -> dict[str, float | None]:
    """Every figure that is no share."""
    sizes = [len(c.listed) for c in cases if c.kind == "known" and c.named]
    errors = [abs(_closure(c)["value"] - c.label["closure"]) for c in _closures(cases)]
    return {
        "set_size": float(np.mean(sizes)) if sizes else None,
        "closure_error_median": float(np.median(errors)) if errors else None,
        "closure_error_p90": float(np.quantile(errors, 0.9)) if errors else None,
        "payload_ratio": payload_ratio(cases),
        "ece": calibration_error(cases),
        "cases": float(len(cases)),
    }


def _closure(case: Judged) -> Record:
    return dict(case.effects[0].get("closure") or {})


def _closures(cases: Iterable[Judged]) -> list[Judged]:
    """Cases in which a name came with a closure, and the true closure is known."""
    return [c for c in cases if c.named and c.label.get("closure") is not None and _closure(c).get("value") is not None]


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


def calibration_error(cases: Iterable[Judged]) -> float | None:
    """Expected calibration error of the first effect's confidence, in five bins of equal count."""
    stated = [(float(c.effects[0]["confidence"]), c.right) for c in cases if c.named and "confidence" in c.effects[0]]
    if len(stated) < BINS:
        return None
    stated.sort(key=lambda pair: pair[0])
    parts = np.array_split(np.array(stated, dtype=np.float64), BINS)
    return float(sum(len(p) * abs(np.mean(p[:, 0]) - np.mean(p[:, 1])) for p in parts) / len(stated))


def true_closure(difference: np.ndarray, before: np.ndarray, after: np.ndarray, level: np.ndarray) -> float | None:
    """Share of the effect's true energy that the correction takes away: 1 - sum((d - (before - after))^2) / sum(d^2).

    All (T, R) [N m], weighted by the floor's `level` (R,); d: what the effect adds to the residual, by the twin; NaN
    rows are left out. None if there is no effect."""
    usable = np.isfinite(difference + before + after)
    d, rest = (np.where(usable, x / level, 0.0) for x in (difference, difference - before + after))
    energy = float(np.sum(d * d))
    return 1.0 - float(np.sum(rest * rest)) / energy if energy > 0.0 else None


def baselines(cases: Sequence[Judged]) -> dict[str, Share]:
    """How often the simple methods in the answers name a detected known effect first."""
    known = [c for c in cases if c.kind == "known" and c.detected]
    names = sorted({name for c in known for name in c.answer.get("baselines") or {}})
    return {name: _baseline([c for c in known if name in (c.answer.get("baselines") or {})], name) for name in names}


def _baseline(cases: Sequence[Judged], name: str) -> Share:
    return share(cases, lambda case: place(case.answer["baselines"][name]) in case.truth)
