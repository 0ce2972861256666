"""Pages of a fleet: an overview, the usual spread of each type, one page a machine; files without a server."""

import re
import shlex
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

import cylforce
from cylforce.files.atomic import replacing
from cylforce.fleet.changes import MachineChange, Shape
from cylforce.fleet.coordinates import OFFSET, RUBBING, ZERO, Coordinate, joint_directions
from cylforce.fleet.courses import Course
from cylforce.programs.fleet.analysis import DAY_S, OfType, Ordered
from cylforce.programs.fleet.pictures import Curve, course_svg, factor_of, spark_svg, spread_svg, title_of
from cylforce.programs.fleet.result import FleetChange, FleetResult
from cylforce.programs.fleet.task import FAILED
from cylforce.programs.fleet.words import ANGLE, DRY, FRICTION, MASS, cause_words
from cylforce.programs.reports.template import templates
from cylforce.signals.estimate import Array

KNOWN = 0.5  # of the spread between machines: a quantity whose error is larger at all times is not shown


def write_pages(path: Path, result: FleetResult, usual: Path | None) -> None:
    """Write the fleet's page at `path` and the machines' pages into a folder beside it. Raises RecordingError.

    usual: file of the usual spread
    """
    folder = path.with_name(f"{path.stem}_machines")
    folder.mkdir(exist_ok=True)
    made = templates(__package__)
    origin = {"date": f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC", "version": cylforce.__version__}
    each = [(kind, ordered) for kind in result.analysis.types for ordered in kind.machines.values()]
    files = files_of([ordered.machine for _, ordered in each])
    machines = [_machine(result, kind, ordered, usual) | {"file": files[ordered.machine]} for kind, ordered in each]
    for machine in machines:
        _write(
            folder / machine["file"],
            made.get_template("machine.html.j2").render(**machine, origin=origin, back=path.name, cause=cause_words),
        )
    silent = _silent(result, {machine["name"] for machine in machines})
    lines = sorted(machines, key=lambda m: (-m["severity"], m["name"]))
    values = {"machines": lines, "silent": silent, "cards": _cards(result, machines), "notes": result.notes}
    values |= {"spreads": [_spreads(kind) for kind in result.analysis.types], "folder": folder.name}
    _write(path, made.get_template("fleet.html.j2").render(**values, origin=origin))


def _silent(result: FleetResult, shown: set[str]) -> dict[str, list[str]]:
    """Return the reasons, each once, of machines without a page, from the rows of their recordings."""
    found: dict[str, list[str]] = {}
    for row in result.rows:
        if row["machine"] not in shown:
            reasons = found.setdefault(row["machine"], [])
            said = f"{row['state']}: {row['reason']}".strip(": ")
            if said not in reasons:
                reasons.append(said)
    return dict(sorted(found.items()))


def _write(path: Path, text: str) -> None:
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def files_of(machines: Sequence[str]) -> dict[str, str]:
    """Return the name of each machine's page, unique even where a system ignores case."""
    found, taken = dict[str, str](), set[str]()
    for machine in sorted(machines):
        safe, number = re.sub(r"[^\w.-]", "_", machine), 1
        while (file := f"{safe}_{number}.html" if number > 1 else f"{safe}.html").casefold() in taken:
            number += 1
        found[machine] = file
        taken.add(file.casefold())
    return found


def _cards(result: FleetResult, machines: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    changed = sum(bool(m["lasting"]) for m in machines)
    failed = sum(row["state"] == FAILED for row in result.rows)
    return [
        {"title": "Machines", "value": str(len(machines)), "note": "with recordings", "good": True, "bad": False},
        {
            "title": "Changed",
            "value": str(changed),
            "note": "lastingly, 90 % sure or more",
            "good": not changed,
            "bad": changed > 0,
        },
        {"title": "Recordings", "value": str(len(result.rows)), "note": "looked at", "good": True, "bad": False},
        {
            "title": "Not usable",
            "value": str(failed),
            "note": "their machines' pages say why",
            "good": not failed,
            "bad": False,
        },
    ]


def _machine(result: FleetResult, kind: OfType, ordered: Ordered, usual: Path | None) -> dict[str, Any]:
    told = kind.told(ordered.machine)
    changes = [c for c in result.changes if c.machine == ordered.machine]
    lasting = [c for c in changes if c.altered.shape is not Shape.DAY]
    course, t = told.course, _times(ordered, len(told.course.own))
    rows = [row for row in result.rows if row["machine"] == ordered.machine]
    return {
        "name": ordered.machine,
        "kind": kind.name,
        "changes": changes,
        "lasting": lasting,
        "severity": _severity(lasting, changes, course),
        "gap": _last(course.from_past),
        "spark": _spark(kind, course, t, lasting),
        "courses": _courses(kind, course, t, lasting, _ends(ordered, len(t))),
        "rows": rows,
        "ask": _command(ordered, lasting[0].altered.first, usual) if lasting else "",
        "latest": rows[-1]["made"][:10] if rows else "",
    }


def _severity(lasting: Sequence[FleetChange], changes: Sequence[FleetChange], course: Course) -> float:
    """Return the rank of a machine: lasting changes by size over error, then single days, then the latest
    difference.
    """
    sizes = [abs(c.altered.size) / max(c.altered.error, 1e-30) for c in lasting]
    return 1e3 * len(lasting) + min(max(sizes, default=0.0), 900.0) + 10.0 * bool(changes) + _last(course.from_past)


def _last(values: Array) -> float:
    return float(np.nan_to_num(values[-1])) if len(values) else 0.0


def _times(ordered: Ordered, count: int) -> Array:
    recordings = ordered.recordings[-count:] if count else ()
    if not ordered.dated:
        return np.arange(count, dtype=np.float64)
    return np.array([datetime.fromisoformat(each.made).timestamp() / DAY_S for each in recordings])


def _spark(kind: OfType, course: Course, t: Array, lasting: Sequence[FleetChange]) -> Markup:
    """Return the course of the changed quantity; without a change, of the difference from the machine's past."""
    k = _column(kind.fleet.quantities, lasting[0].altered) if lasting else None
    y = np.nan_to_num(course.from_past, nan=1.0) if k is None else course.own[:, k]
    return spark_svg(Curve(t, y, np.zeros_like(y), (0.0, 0.0)))


def _column(quantities: Sequence[Coordinate], altered: MachineChange) -> int | None:
    """Return the quantity that shows a change best."""
    named = {FRICTION: RUBBING[0], DRY: RUBBING[0], MASS: "X", ANGLE: OFFSET}
    wanted = f"{altered.at}.{named.get(altered.name, ZERO)}"
    return next((k for k, c in enumerate(quantities) if c.name == wanted), None)


def _ends(ordered: Ordered, count: int) -> tuple[str, str]:
    """Return the names of the first and the last of the latest recordings."""
    names = [each.made[:10] if ordered.dated else each.stored.name for each in ordered.recordings[-count:]]
    return names[0], names[-1]


def everyday(kind: OfType) -> tuple[Array, Array]:
    """Return standard deviations (K,) of all quantities, from day to day and within a day.

    They include each quantity's own variation and that of several quantities together.
    """
    usual, size = kind.fleet.usual, len(kind.fleet.quantities)
    squares = np.column_stack([np.eye(size), joint_directions(kind.model, usual.mean[:size])]) ** 2
    return np.sqrt(squares @ usual.days**2), np.sqrt(squares @ usual.within**2)


def _courses(
    kind: OfType, course: Course, t: Array, lasting: Sequence[FleetChange], ends: tuple[str, str]
) -> list[dict[str, Any]]:
    """Return the courses of all quantities, those that changed first."""
    usual, found, (daily, _) = kind.fleet.usual, [], everyday(kind)
    first = {_column(kind.fleet.quantities, c.altered) for c in lasting}
    marks = [float((t[c.altered.first - 1] + t[c.altered.first]) / 2.0) for c in lasting if c.altered.first > 0]
    for k, c in enumerate(kind.fleet.quantities):
        if np.min(course.own_error[:, k]) > KNOWN * usual.between[k]:
            continue
        factor, _ = factor_of(c)
        band = (float(usual.mean[k]) * factor, float(usual.between[k]) * factor)
        curve = Curve(
            t, course.own[:, k] * factor, course.own_error[:, k] * factor, band, marks, ends, daily[k] * factor
        )
        found.append({"title": title_of(c), "changed": k in first, "svg": course_svg(title_of(c), curve)})
    return sorted(found, key=lambda each: not each["changed"])


def _command(ordered: Ordered, first: int, usual: Path | None) -> str:
    """Return the command of a whole diagnosis."""
    before, after = ordered.recordings[:first], ordered.recordings[first:]
    words = ["cylforce", "gap", before[0].stored.machine_file, *(each.stored.address for each in after[:3])]
    for each in before[-3:]:
        words += ["--reference", each.stored.address]
    words += [] if usual is None else ["--usual", str(usual)]
    return shlex.join([*words, "--html", "gap.html"])


def _spreads(kind: OfType) -> dict[str, Any]:
    usual, names = kind.fleet.usual, list(kind.fleet.machines)
    far = [bool(kind.told(name).lasting) for name in names]
    drawn, (daily, within) = [], everyday(kind)
    for k, c in enumerate(kind.fleet.quantities):
        values = np.array([np.average(kind.told(n).course.own[:, k]) for n in names])
        errors = np.array([np.min(kind.told(n).course.own_error[:, k]) for n in names])
        if np.median(errors) > KNOWN * usual.between[k]:
            continue
        factor, _ = factor_of(c)
        spread = (usual.mean[k] * factor, usual.between[k] * factor, daily[k] * factor)
        numbers = [f"{x:.4g}" for x in (*spread, within[k] * factor)]
        svg = spread_svg(title_of(c), values * factor, spread, far)
        drawn.append({"title": title_of(c), "svg": svg, "numbers": numbers})
    return {"kind": kind.name, "drawn": drawn, "machines": usual.machines, "recordings": usual.recordings}
