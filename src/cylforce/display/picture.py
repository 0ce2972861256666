"""The picture that a page shows: plain numbers, lists and codes, made from what was heard. Where there is no value
there is None and a reason, never a number."""

from collections.abc import Mapping
from math import isfinite
from typing import Any, NamedTuple

import numpy as np

from cylforce.display.listener import Listener
from cylforce.display.panel import Loading
from cylforce.estimation.channels import Channels
from cylforce.mechanics.outline import Place, outline
from cylforce.service import publication as names
from cylforce.signals.estimate import Array, Reason, Sample, Status
from cylforce.signals.kinds import Signal

SILENT = 255  # stands for a reason: the service sends nothing
Picture = dict[str, Any]
LAST_SHARE = 1.2  # of the usual bucket: what remains is less, so the next bucket is the last; chosen


class Marks(NamedTuple):
    """Settings of the page: from which share of the target on the bar is amber, green, red; after how many minutes
    without a new zero it reminds of it (0: never)."""

    amber: float = 0.75
    green: float = 0.95
    red: float = 1.1
    check_zero_min: float = 0.0


class Painter:
    """Makes pictures of one machine."""

    def __init__(self, listener: Listener, marks: Marks) -> None:
        self._listener, self._marks, self._begun_us = listener, marks, 0
        service = listener.service
        self._machine = service.machine
        self._channels = Channels(service.machine, service.filters)

    def work(self, loading: Loading, t_us: int) -> Picture:
        """What the operator sees."""
        values, sample = self._listener.values(t_us), self._listener.sample(t_us)
        weight = _weight(values)
        return {
            "t_ms": t_us // 1000,
            "weight": weight,
            "force": _force(values, names.SOIL, (names.SOIL_X_ERROR, names.SOIL_Z_ERROR)),
            "resultant": _force(values, names.FORCES, (names.X_ERROR, names.Z_ERROR)),
            "arm": self._arm(sample),
            "rated": self._rated(loading),
            "tools": self._listener.service.tools,
            "truck": _truck(loading, weight, self._marks.red),
            "buckets": [bucket._asdict() for bucket in loading.buckets],
            "marks": self._marks._asdict(),
            "check_zero": self._check_zero(t_us),
        }

    def engineering(self, loading: Loading, t_us: int) -> Picture:
        """What a service engineer sees beside it."""
        sample, ages = self._listener.sample(t_us), self._listener.ages(t_us)
        nodes = self._listener.nodes
        known = {node.node_id: node.name for node in self._listener.service.nodes}
        known[self._listener.service.node_id] = "cylforce"
        return self.work(loading, t_us) | {
            "signals": [_signal(self._machine.signals, sample, k, age) for k, age in enumerate(ages)],
            "cylinders": self._cylinders(sample, loading),
            "nodes": [
                {
                    "id": number,
                    "name": name,
                    "state": nodes[number].state if number in nodes else None,
                    "age_ms": (t_us - nodes[number].t_us) // 1000 if number in nodes else None,
                    "emergency": self._listener.emergencies.get(number, 0),
                }
                for number, name in sorted(known.items())
            ],
            "bits_per_second": self._listener.bits_per_second(t_us),
        }

    def _arm(self, sample: Sample) -> Picture | None:
        """Outlines [m], None while an angle is not known. The chassis' pitch is not drawn."""
        theta = self._channels.read(sample.values)[: self._machine.size]
        if not np.isfinite(theta).all():
            return None
        found = outline(self._machine, theta)
        tool = complex(self._machine.tool_point(theta).place)
        shapes = {"links": found.links, "cylinders": found.cylinders, "rockers": found.rockers, "bars": found.bars}
        drawn: Picture = {name: [_points(shape) for shape in each] for name, each in shapes.items()}
        return drawn | {"tool": _points([tool])[0], "reach": self._reach, "fresh": not any(sample.reasons)}

    def _check_zero(self, t_us: int) -> bool:
        """Whether the zero was not set for too long; from the start of the display on."""
        self._begun_us = self._begun_us or t_us
        after_us = 60e6 * self._marks.check_zero_min
        return 0.0 < after_us < t_us - max(self._begun_us, self._listener.zeroed_us)

    def _rated(self, loading: Loading) -> float:
        """Rated payload [kg] with the tool that is chosen."""
        service, number = self._listener.service, loading.known.tool if loading.known else 0
        return service.fitted(service.tools[number]).machine.rated_payload if number < len(service.tools) else 0.0

    @property
    def _reach(self) -> float:
        """No point is farther from the first pin than this [m]."""
        return float(sum(self._machine.lengths[:-1])) + abs(self._machine.tool)

    def _cylinders(self, sample: Sample, loading: Loading) -> list[Picture]:
        """Force of each cylinder [N] as its pressures give it, and the torque [N m] at its joint that the empty machine
        does not explain; None of a cylinder that acts on more joints than one."""
        force: Array = self._channels.read(sample.values)[self._channels.forces]
        left = dict(zip(self._machine.rows, loading.known.unexplained if loading.known else (), strict=False))
        return [
            {
                "name": cylinder.name,
                "force": _number(float(f)),
                "unexplained": left.get(span[0]) if len(span) == 1 else None,
            }
            for cylinder, span, f in zip(self._machine.cylinders, self._machine.spans, force, strict=True)
        ]


def _number(value: float) -> float | None:
    return value if isfinite(value) else None


def _points(shape: tuple[Place, ...] | list[Place]) -> list[tuple[float, float] | None]:
    """Corners [m], millimetres are enough; None for what cannot be closed."""
    return [(round(z.real, 3), round(z.imag, 3)) if isfinite(abs(z)) else None for z in shape]


def _signal(signals: tuple[Signal, ...], sample: Sample, k: int, age: float) -> Picture:
    value = _number(float(sample.values[k]))
    return {
        "name": signals[k].name,
        "value": value,
        "unit": signals[k].unit,
        "age_ms": round(1e3 * age) if isfinite(age) else None,
        "reason": int(sample.reasons[k]),
    }


def _quality(values: Mapping[str, float], name: str) -> tuple[int, int]:
    """Status and reason; INVALID and SILENT where nothing was heard."""
    if name not in values:
        return int(Status.INVALID), SILENT
    byte = int(values[name])
    return byte & 3, byte >> 2


def _weight(values: Mapping[str, float]) -> Picture:
    status, reason = _quality(values, names.PAYLOAD_QUALITY)
    shown = {"gross": names.GROSS, "net": names.NET, "error": names.GROSS_ERROR}
    known = {key: _number(values.get(name, float("nan"))) for key, name in shown.items()}
    if status != Status.INVALID and None in known.values():
        missing = any(name not in values for name in shown.values())
        status, reason = int(Status.INVALID), SILENT if missing else int(Reason.OUT_OF_DECLARED_RANGE)
    if status == Status.INVALID:
        known = dict.fromkeys(known)
    return known | {"status": status, "reason": reason}


def _force(values: Mapping[str, float], of: tuple[str, ...], errors: tuple[str, str]) -> Picture:
    """Components, magnitude [N], direction [rad] and the components' standard errors; None where there is none."""
    status, reason = _quality(values, names.QUALITY[of[2]])
    keys = ("x", "z", "magnitude", "direction")
    known = {key: _number(values.get(name, float("nan"))) for key, name in zip(keys, of, strict=True)}
    known |= {f"error_{axis}": _number(values.get(name, float("nan"))) for axis, name in zip("xz", errors, strict=True)}
    if status == Status.INVALID:
        known = dict.fromkeys(known)
    return known | {"status": status, "reason": reason}


def _truck(loading: Loading, weight: Picture, red: float) -> Picture | None:
    known = loading.known
    return None if known is None else known._asdict() | {"loaded": known.loaded} | _advice(loading, weight, red)


def _advice(loading: Loading, weight: Picture, red: float) -> Picture:
    """Share of the target that is in the truck, and with the bucket that hangs now; what remains [kg]; whether the next
    bucket is the last one, which share of a usual bucket it needs, whether a usual one would overload (beyond `red`
    times the target); what to tip off of the bucket that hangs [kg]."""
    known = loading.known
    if known is None or known.target <= 0.0:
        nothing = dict.fromkeys(("share", "with_bucket", "remaining", "next_share", "tip_off"))
        return nothing | {"last_bucket": False, "overloads": False}
    hanging, loaded = max(weight["net"] or 0.0, 0.0), known.loaded
    remaining = known.target - loaded
    usual = known.total / known.filled if known.filled else None
    last = usual is not None and 0.0 < remaining <= LAST_SHARE * usual
    shares = {"share": loaded / known.target, "with_bucket": (loaded + hanging) / known.target}
    next_share = min(1.0, remaining / usual) if usual and usual > 0.0 and remaining > 0.0 else None
    tip_off = hanging - remaining if remaining > 0.0 and hanging > remaining else None
    overloads = usual is not None and loaded + usual > red * known.target
    rest = {"next_share": next_share, "tip_off": tip_off, "overloads": overloads}
    return shares | rest | {"remaining": remaining, "last_bucket": last}
