"""Events at the teeth: how soon a contact is noticed, how soon a buried stiff object shows in the force and as an
event, false alarms in empty motion. The truth passed no filter."""

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from cylforce.signals.contact import EventKind
from cylforce.signals.estimate import Array
from studies._contacts import Run, wanted
from studies.force import quantile

NOTICED = 0.01  # times the rated force: the true force from which on the delay counts
PAUSE_S = 0.5  # s without contact before one counts as new
SEARCH_S = 1.0  # s after which a contact or an object counts as missed
JUMP_N, JUMP_S = 15e3, 0.1  # a stiff object: rise of the true force within this time
SHARE = 0.8  # of the true jump
JUMP_ENDS_S = 0.4  # s after its beginning, when the jump is over


def contact_delays(run: Run) -> list[float]:
    """Time [ms] from 1 % of the rated force to the event, for each contact; SEARCH_S where there was none. An event
    that came earlier, while the true force was smaller, counts as no delay."""
    limit = NOTICED * run.core.monitor.rated_force
    begins = _beginnings(run.size > limit, run.t_s)
    touched = _beginnings(run.size > 1.0, run.t_s)
    times = run.times(EventKind.CONTACT_BEGINS)
    return [_delay(begin, max((t for t in touched if t <= begin), default=begin), times) for begin in begins]


def _beginnings(on: NDArray[np.bool_], t_s: Array) -> list[float]:
    """Times at which something begins after a pause."""
    changes = np.flatnonzero(np.diff(on.astype(np.int64)) > 0) + 1
    steps = round(PAUSE_S / float(np.median(np.diff(t_s))))
    return [float(t_s[k]) for k in changes if not on[max(0, k - steps) : k].any()]


def _delay(begin: float, earliest: float, times: Sequence[float]) -> float:
    found = [t for t in times if earliest <= t <= begin + SEARCH_S]
    return 1e3 * max(0.0, found[0] - begin) if found else 1e3 * SEARCH_S


def jumps(run: Run) -> list[int]:
    """Rows at which the true force begins to jump."""
    steps = round(JUMP_S / float(np.median(np.diff(run.t_s))))
    rises = run.size[steps:] - run.size[:-steps] > JUMP_N
    found: list[int] = []
    for k in np.flatnonzero(rises).tolist():
        if not found or run.t_s[k] - run.t_s[found[-1]] > SEARCH_S:
            found.append(int(k + np.argmax(np.diff(run.size[k : k + steps + 1]))))
    return found


def jump_delays(run: Run) -> list[float]:
    """Time [ms] from the beginning of each jump until the published force has made SHARE of it."""
    found = np.hypot(*run.found("force")[0].T)
    return [_risen(run.t_s[k:], run.size[k:], found[k:]) for k in jumps(run)]


def _risen(t_s: Array, true: Array, found: Array) -> float:
    jump = float(true[t_s <= t_s[0] + JUMP_ENDS_S].max() - true[0])
    reached = np.flatnonzero(found >= true[0] + SHARE * jump)
    return 1e3 * float(t_s[reached[0]] - t_s[0]) if len(reached) else 1e3 * SEARCH_S


def stiff_found(run: Run) -> tuple[list[float], int]:
    """Delays [ms] of the events of stiff objects behind the jumps, and how many events belong to none."""
    begins = [float(run.t_s[k]) for k in jumps(run)]
    times = run.times(EventKind.STIFF_OBJECT)
    delays = [_delay(begin, begin, times) for begin in begins]
    return delays, sum(not any(b - 0.05 <= t <= b + SEARCH_S for b in begins) for t in times)


def false_alarms(run: Run) -> list[float]:
    """Times [s] of beginnings of contact and of stiff objects in empty motion."""
    return run.times(EventKind.CONTACT_BEGINS, EventKind.STIFF_OBJECT)


def hours(runs: Sequence[Run]) -> float:
    """How long recordings are together [h]."""
    return sum(float(r.t_s[-1] - r.t_s[0]) for r in runs) / 3600.0


def false_per_hour(runs: Sequence[Run]) -> float | None:
    """False alarms in an hour of such recordings; None of nothing."""
    return sum(len(false_alarms(r)) for r in runs) / hours(runs) if runs else None


def figures(runs: Sequence[Run]) -> dict[str, Any]:
    """All figures."""
    air, sharp = ([r for r in runs if r.kind == kind] for kind in ("air", "sharp"))
    touching = [r for r in runs if r.kind not in ("air", "sharp")]
    delays = [delay for run in touching for delay in contact_delays(run)]
    jumped = [delay for run in touching for delay in jump_delays(run)]
    stiff = [stiff_found(run) for run in touching]
    return {
        "contacts": len(delays),
        "contact_ms_median": quantile(np.array(delays), 50.0),
        "contact_ms_p95": quantile(np.array(delays)),
        "contacts_missed": sum(delay >= 1e3 * SEARCH_S for delay in delays),
        "false_per_hour": false_per_hour(air),
        "hours_of_empty_motion": hours(air),
        "false_per_hour_sharp": false_per_hour(sharp),
        "jumps": len(jumped),
        "jump_ms_p95": quantile(np.array(jumped)),
        "jump_ms_worst": max(jumped, default=None),
        "stiff_ms_p95": quantile(np.array([delay for each, _ in stiff for delay in each])),
        "stiff_missed": sum(delay >= 1e3 * SEARCH_S for each, _ in stiff for delay in each),
        "stiff_false": sum(count for _, count in stiff),
        "by_machine": [
            {"machine": r.machine, "kind": r.kind, "contact_ms": contact_delays(r), "jump_ms": jump_delays(r)}
            for r in touching
        ],
    }


def main() -> None:
    """Measure and print."""
    options = wanted("events", __doc__, ("digging", "air", "sharp"))
    found = figures(list(options.runs))
    for name, value in found.items():
        if name != "by_machine":
            Console(highlight=False).print(f"{name}: {value:.4g}" if isinstance(value, float) else f"{name}: {value}")
    if options.json:
        options.json.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
