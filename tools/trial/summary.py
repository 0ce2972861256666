"""The trial's table for people and for programs: every figure with its bounds and its aim."""

from collections.abc import Sequence
from typing import Any

from rich.console import Console
from rich.table import Table

from .library import CANDIDATES
from .orders import PER_MACHINE
from .scoring import Judged, Share, baselines, bounds, figures, shares

Record = dict[str, Any]
AIMS = {  # at least, or at most
    "detected": (">=", 0.95),
    "top1_clean": (">=", 0.97),
    "top1_clutter": (">=", 0.92),
    "precision": (">=", 0.99),
    "named_share": (">=", 0.70),
    "false_alarms": ("<=", 0.01),
    "foreign_named": ("<=", 0.03),
    "unknown_recall": (">=", 0.90),
    "set_coverage": (">=", 0.97),
    "set_size": ("<=", 1.3),
    "pairs_exact": (">=", 0.90),
    "poor_wrong": ("<=", 0.02),
    "closure_error_median": ("<=", 0.02),
    "closure_error_p90": ("<=", 0.08),
    "closure_coverage": (">=", 0.85),
    "payload_ratio": ("<=", 1.2),
    "ece": ("<=", 0.04),
}

WORDS = {
    "detected": "visible effects that are detected",
    "top1_clean": "named first, of the detected, without clutter",
    "top1_clutter": "the same with clutter",
    "precision": "right when a single cause is named",
    "named_share": "a single cause is named, of the detected",
    "false_alarms": "false alarms",
    "foreign_named": "outside the library, given a name",
    "unknown_recall": "outside the library, visible: unknown",
    "set_coverage": "the truth is among the causes given",
    "set_size": "mean number of causes given",
    "pairs_exact": "two effects at once, both named exactly",
    "poor_wrong": "too little motion: wrong name",
    "closure_error_median": "error of the removed share, median",
    "closure_error_p90": "the same, 90th percentile",
    "closure_coverage": "its interval contains the true share",
    "payload_ratio": "payload error over that of a fit that knows",
    "ece": "calibration error of the confidence",
}


def judged(records: Sequence[Record]) -> list[Judged]:
    """The records of a table as scorers see them."""
    return [Judged(r["label"] | r["after"], r["answer"]) for r in records]


def result(records: Sequence[Record]) -> Record:
    """All figures by name, `bounds` {name: [low, high]}, `counts` {name: [hits, count]}."""
    cases = judged(records)
    found = shares(cases)
    return {
        **{name: part.value for name, part in found.items()},
        **figures(cases),
        "bounds": {name: list(bounds(part)) for name, part in found.items() if part.cases},
        "counts": {name: list(part) for name, part in found.items()},
        "baselines": {name: part.value for name, part in baselines(cases).items()} | {"chance": 1.0 / CANDIDATES},
        "failed": sum(c.answer["verdict"] == "failed" for c in cases),
        "machines": len({r["order"]["machine"] for r in records}),
        "cases_per_machine": PER_MACHINE,
        "seconds": _seconds(records),
    }


def listed(records: Sequence[Record]) -> list[list[str]]:
    """One short line per case, below its headings: what was hidden, what was answered."""
    heads = "case kind poor clutter hidden sigmas verdict named confidence stated low high true payload_kg oracle_kg"
    rows = [[*heads.split(), "sealed", "salt"]]
    for record in records:
        label, answer, after = record["label"], record["answer"], record["after"]
        effects = answer.get("effects") or []
        first = effects[0] if effects else {}
        closure = first.get("closure") or {}
        payload = ((answer.get("end_quantities") or {}).get("payload_kg") or {}).get("after")
        numbers = [first.get("confidence"), *(closure.get(key) for key in ("value", "low", "high"))]
        numbers += [after.get("closure"), payload, after.get("oracle_payload_kg")]
        hidden = " + ".join(f"{e['name']}@{e['at']}" for e in label["effects"])
        sigmas = " + ".join(f"{e['sigmas']:.0f}" for e in label["effects"])
        named = " + ".join("/".join(f"{e['name']}@{e['at']}" for e in (one, *one["confused_with"])) for one in effects)
        texts = [str(record["case"]), label["kind"], label["poor"], "yes" if label["clutter"] else ""]
        texts += [hidden, sigmas, answer["verdict"], named, *("" if x is None else f"{x:.3g}" for x in numbers)]
        rows.append([*texts, record["sealed"], record["salt"]])
    return rows


def _seconds(records: Sequence[Record]) -> Record:
    count = max(len(records), 1)
    return {
        "simulation": sum(r["simulated_s"] for r in records) / count,
        "diagnosis": sum(r["answer"].get("seconds", 0.0) for r in records) / count,
    }


def show(records: Sequence[Record], console: Console) -> None:
    """The table."""
    cases, found = judged(records), result(records)
    table = Table("figure", "value", "95 % bounds", "of", "aim", "met", title=f"withheld trial, {len(cases)} cases")
    for name, (way, aim) in AIMS.items():
        value, part = found[name], Share(*found["counts"].get(name, (0, 0)))
        low, high = found["bounds"].get(name, (None, None))
        met = "" if value is None else ("yes" if (value >= aim if way == ">=" else value <= aim) else "no")
        table.add_row(
            WORDS[name],
            "-" if value is None else f"{value:.3f}",
            "" if low is None else f"{low:.3f} ... {high:.3f}",
            f"{part.hits}/{part.cases}" if part.cases else "",
            f"{way} {aim:g}",
            met,
        )
    console.print(table)
    console.print(_misses(cases))
    console.print("first name right, simple methods:", {k: round(v, 3) for k, v in found["baselines"].items()})
    times = found["seconds"]
    console.print(f"per case: {times['simulation']:.1f} s simulation, {times['diagnosis']:.1f} s diagnosis")


def _misses(cases: Sequence[Judged]) -> Table:
    """By effect: how often detected, right, named alone."""
    table = Table("effect", "cases", "visible", "detected", "right", "one cause", "taken for")
    names = sorted({e["name"] for c in cases if c.kind in ("known", "foreign") for e in c.label["effects"]})
    for name in names:
        own = [c for c in cases if c.kind in ("known", "foreign") and c.label["effects"][0]["name"] == name]
        counts = [sum(test) for test in zip(*((c.visible, c.detected, c.right, c.one) for c in own), strict=True)]
        wrong = [c.effects[0]["name"] for c in own if c.named and not c.right]
        table.add_row(name, str(len(own)), *map(str, counts), ", ".join(sorted(wrong)))
    return table
