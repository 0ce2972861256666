"""The answer of `cylforce gap` where pressures and angles are not on one clock."""

from collections.abc import Sequence
from typing import Any

from cylforce.diagnosis.decide import Verdict
from cylforce.diagnosis.explain import INTERVAL
from cylforce.effects.incidents.clock_fault import ClockFault as ClockEffect
from cylforce.readings.clocks import ClockSlip

CLOSING = ((Verdict.EXPLAINED, 0.9), (Verdict.PARTLY, 0.7))  # share of the energy that the right clock must remove
HIGHEST_CONFIDENCE = 0.99


def off_clock(faults: Sequence[ClockSlip]) -> dict[str, Any]:
    """Return the answer where nothing but the clocks can be concluded: forces and motion do not belong together.

    faults: the one with the largest lag first
    """
    worst = faults[0]
    verdict = next((v for v, least in CLOSING if worst.closed > least), Verdict.UNKNOWN)
    each = [f for k, f in enumerate(faults) if not any({*f.sensors} <= {*larger.sensors} for larger in faults[:k])]
    effects = [] if verdict is Verdict.UNKNOWN else [_effect(fault) for fault in each]
    cure = [ClockEffect().about.confirm]
    return {"verdict": str(verdict), "effects": effects, "reason": apart(faults), "next_experiment": cure}


def apart(faults: Sequence[ClockSlip]) -> str:
    """Return the sentence that pressures and angles are not on one clock, with the largest lag."""
    worst, names = faults[0], ", ".join(dict.fromkeys(fault.name for fault in faults))
    whose = "the pressures" if worst.whole else f"{' and '.join(worst.sensors)}, and no other pressures,"
    others = "".join(f", or {_late(a)} and {_late(b)}" for a, b in worst.alternatives)
    also = f" (as the motion repeats itself, it may also be{others[4:]})" if others else ""
    return (
        f"pressures and angles are not on one clock in {names}: in {worst.name} {whose} are "
        f"{_late(worst.first)} after {worst.begins:.0f} s and {_late(worst.last)} after {worst.ends:.0f} s{also}. Pair "
        "them by the time at which they were measured, not by their number, and record again"
    )


def _late(lag: float) -> str:
    return f"{abs(lag):.2f} s {'late' if lag >= 0.0 else 'early'}"


def _effect(fault: ClockSlip) -> dict[str, Any]:
    value, error = fault.largest
    begin, end = f"{fault.first:.2f} s at {fault.begins:.0f} s", f"{fault.last:.2f} s at {fault.ends:.0f} s"
    about = ClockEffect().about
    size = {"value": value, "low": value - INTERVAL * error, "high": value + INTERVAL * error, "unit": about.unit}
    return {
        "name": about.name,
        "at": "machine",
        "sensors": list(fault.sensors),
        "when": f"{begin}, {end} of {fault.name}",
        "parameters": {"size": size},
        "shape": {},
        "confidence": min(fault.probability, HIGHEST_CONFIDENCE),
        "confused_with": [],
        "same_as": [],
        "alternatives": [{"first_s": first, "last_s": last} for first, last in fault.alternatives],
    }
