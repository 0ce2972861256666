"""The trial's table for people and for programs: every figure with its bounds and its aim."""

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

from rich.console import Console
from rich.table import Column, Table

from layers.intervals import wilson

from .effects.library import CANDIDATES
from .judged import Judged, Share, share
from .orders import PER_MACHINE
from .scoring import baselines, figures, shares

Record = dict[str, Any]
OWN = "reference machines"
AIMS = {  # at least, or at most; of reference machines, of labelled folders
    "detected": (">=", 0.95, 0.95),
    "first": (">=", 0.85, 0.80),
    "dig_first": (">=", 0.60, 0.60),
    "top1_clean": (">=", 0.88, 0.80),
    "top1_clutter": (">=", 0.80, 0.80),
    "in_set": (">=", 0.93, 0.93),
    "set_size": ("<=", 1.6, 1.6),
    "set_coverage": (">=", 0.93, 0.93),
    "named_share": (">=", 0.55, 0.55),
    "precision": (">=", 0.97, 0.97),
    "false_alarms": ("<=", 0.02, 0.05),
    "order_digging": ("<=", 0.05, 0.05),
    "harsh_alarms": ("<=", 0.02, 0.05),
    "sure_wrong": ("<=", 0.02, 0.02),
    "joint": (">=", 0.90, 0.90),
    "foreign_named": ("<=", 0.03, 0.03),
    "foreign_alone": ("<=", 0.06, 0.10),
    "unknown_recall": (">=", 0.80, 0.80),
    "pairs_in_set": (">=", 0.80, 0.80),
    "pairs_exact": (">=", 0.60, 0.60),
    "identify_first": (">=", 1.0, 1.0),
    "leave_one_out_named": ("<=", 0.08, 0.08),
    "poor_wrong": ("<=", 0.02, 0.02),
    "ece": ("<=", 0.06, 0.06),
    "brier_skill": (">=", 0.4, 0.4),
    "closure_error_median": ("<=", 0.02, 0.02),
    "closure_error_p90": ("<=", 0.08, 0.08),
    "closure_coverage": (">=", 0.85, 0.85),
    "payload_ratio": ("<=", 1.2, 1.2),
}

WORDS = {
    "detected": "visible effects that are detected",
    "first": "visible effects that are named first, in the air",
    "dig_first": "the same in normal work",
    "in_set": "visible effects in the 90 % set",
    "top1_clean": "named first, of the detected, without clutter",
    "top1_clutter": "the same with clutter",
    "precision": "right when a single cause is named",
    "named_share": "a single cause is named, of the detected",
    "false_alarms": "in order: named or unknown",
    "order_digging": "the same in normal work",
    "harsh_alarms": "the same with cold oil on a steep slope",
    "sure_wrong": "a wrong name, 80 % sure, of all cases",
    "joint": "the joint is right where something visible is named",
    "foreign_named": "outside the library, given a wrong name",
    "foreign_alone": "the same, visible, as a single cause",
    "unknown_recall": "outside the library, visible: unknown",
    "set_coverage": "the truth is among the causes given, if any",
    "set_size": "mean size of the set, of the detected",
    "pairs_in_set": "two effects at once, both in the set or named",
    "identify_first": "data sheet alone: nothing is named, identify first",
    "leave_one_out_named": "effect left out of the library: a name, 80 % sure",
    "brier_skill": "Brier skill over the base rate",
    "pairs_exact": "two effects at once, both named exactly",
    "poor_wrong": "too little motion: wrong name",
    "closure_error_median": "error of the removed share, median",
    "closure_error_p90": "the same, 90th percentile",
    "closure_coverage": "its interval contains the true share",
    "payload_ratio": "payload error over that of a fit that knows",
    "ece": "expected calibration error",
}


def judged(records: Sequence[Record]) -> list[Judged]:
    """The records of a table as scorers see them: those asked without their effect are cases of their own."""
    found = [Judged(r["label"] | r["after"], r["answer"]) for r in records]
    return found + [Judged(r["label"] | {"kind": "without"}, r["without"]) for r in records if r.get("without")]


def result(records: Sequence[Record], source: str = OWN) -> Record:
    """All figures by name, `bounds` {name: [low, high]} (Wilson), `counts` {name: [hits, count]}."""
    cases = judged(records)
    found = shares(cases)
    return {
        **{name: part.value for name, part in found.items()},
        **figures(cases),
        "bounds": {name: list(wilson(*part)) for name, part in found.items() if part.cases},
        "counts": {name: list(part) for name, part in found.items()},
        "baselines": {name: part.value for name, part in baselines(cases).items()} | {"chance": 1.0 / CANDIDATES},
        "failed": sum(c.answer["verdict"] == "failed" for c in cases),
        "machines": len({r["order"]["machine"] for r in records}),
        "cases_per_machine": PER_MACHINE,
        "source": source,
        "effects": {name: {k: list(part) for k, part in row.items()} for name, row in by_effect(cases).items()},
        "seconds": _seconds(records),
    }


def listed(records: Sequence[Record]) -> list[list[str]]:
    """One short line per case, below its headings: what was hidden, what was answered."""
    heads = (
        "case kind poor clutter hidden over_floor verdict named confidence stated low high true payload_kg oracle_kg"
    )
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
        over_floor = " + ".join(f"{e['over_floor']:.3g}" for e in label["effects"])
        named = " + ".join(
            "/".join(f"{e['name']}@{e['at']}" for e in (one, *(one.get("confused_with") or []))) for one in effects
        )
        texts = [str(record["case"]), label["kind"], label["poor"], "yes" if label["clutter"] else ""]
        texts += [hidden, over_floor, answer["verdict"], named, *("" if x is None else f"{x:.3g}" for x in numbers)]
        rows.append([*texts, record.get("sealed", ""), record.get("salt", "")])
    return rows


def _seconds(records: Sequence[Record]) -> Record:
    count = max(len(records), 1)
    return {
        "simulation": sum(r["simulated_s"] for r in records) / count,
        "diagnosis": sum(r["answer"].get("seconds", 0.0) for r in records) / count,
    }


def show(records: Sequence[Record], console: Console, source: str = OWN) -> None:
    """The table."""
    cases, found = judged(records), result(records, source)
    title = f"{source}: {found['cases']:.0f} cases, {found['failed']} failed"
    table = Table(Column("figure", no_wrap=True), "value", "95 % (Wilson)", "of", "aim", "met", title=title)
    for name, (way, *aims) in AIMS.items():
        aim = aims[source != OWN]
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
    console.print(_effects(cases, source))
    if found["log_score"] is not None:
        console.print(f"log score {found['log_score']:.3f}, Brier score {found['brier']:.3f}")
    console.print("first name right, simple methods:", {k: v and round(v, 3) for k, v in found["baselines"].items()})
    times = found["seconds"]
    console.print(f"per case: {times['simulation']:.1f} s simulation, {times['diagnosis']:.1f} s diagnosis")


def answered(case: Judged) -> bool:
    """Whether the first that is said is right: silence, a name at its place, or unknown where the library lacks it."""
    if case.kind == "none":
        return not case.detected
    unknown = case.kind in ("foreign", "without") and case.answer["verdict"] == "unknown"
    return unknown or (case.named and case.right)


COLUMNS: dict[str, Callable[[Judged], bool]] = {  # of the table by effect
    "visible": lambda c: c.visible,
    "detected": lambda c: c.detected,
    "right": answered,
    "in set": lambda c: bool(c.answers & c.possible),
    "one cause": lambda c: c.one,
    "wrong name": lambda c: c.wrong,
}


def stratum(case: Judged) -> str:
    """The row of a case in the table by effect."""
    if case.kind == "none":
        return f"in order: {case.label.get('scenario', '')}"
    names = " + ".join(e["name"] for e in case.label["effects"])
    kinds = {"known": "", "foreign": " (foreign)", "without": " (left out)", "poor": " (poor)"}
    return "pairs" if case.kind == "pair" else names + kinds[case.kind]


def by_effect(cases: Sequence[Judged]) -> dict[str, dict[str, Share]]:
    """The columns of the table by effect, row by row."""
    rows = sorted({stratum(c) for c in cases})
    found = {row: [c for c in cases if stratum(c) == row] for row in rows}
    return {row: {name: share(own, test) for name, test in COLUMNS.items()} for row, own in found.items()}


def _effects(cases: Sequence[Judged], source: str) -> Table:
    """By effect: how often detected, right, named alone; what it was taken for."""
    table = Table(Column(source, no_wrap=True), "cases", *COLUMNS, Column("right, 95 %", no_wrap=True), "taken for")
    for row, found in by_effect(cases).items():
        wrong = Counter(c.effects[0]["name"] for c in cases if stratum(c) == row and c.wrong)
        low, high = wilson(*found["right"])
        taken = ", ".join(f"{name} {count}" for name, count in wrong.most_common())
        counts = [str(part.hits) for part in found.values()]
        table.add_row(row, str(found["visible"].cases), *counts, f"{low:.0%} to {high:.0%}", taken)
    return table
