"""The content of the page as plain numbers, lists and codes, made from received values.

Where there is no value there is None and a reason, never a number.
"""

from collections.abc import Mapping
from math import isfinite
from typing import Any, NamedTuple

import numpy as np

from cylforce.display.listener import Listener
from cylforce.display.panel import Loading
from cylforce.estimation.channels import Channels
from cylforce.mechanics.outline import Place, outline
from cylforce.service import published_values as names
from cylforce.signals.estimate import Array, Reason, Sample, Status
from cylforce.signals.kinds import Signal

SILENT = 255  # instead of a reason: the service sends nothing
Picture = dict[str, Any]  # values as JSON
LAST_SHARE = 1.2  # remaining mass below which the next bucket is the last, times the mean bucket; chosen


class Marks(NamedTuple):
    """Settings of the page.

    amber: share of the target from which on the bar is amber
    green: share of the target from which on the bar is green
    red: share of the target from which on the bar is red
    check_zero_min: minutes without a new zero after which the page reminds of it; 0: never
    """

    amber: float = 0.75
    green: float = 0.95
    red: float = 1.1
    check_zero_min: float = 0.0


class Painter:
    """Makes the pictures of one machine.

    listener: values received from the bus
    marks: settings of the page
    """

    def __init__(self, listener: Listener, marks: Marks) -> None:
        self._listener, self._marks, self._begun_us = listener, marks, 0
        service = listener.service
        self._machine = service.machine
        self._channels = Channels(service.machine, service.filters)

    def work(self, loading: Loading, t_us: int) -> Picture:
        """Return the operator's picture at the time `t_us` [us]."""
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
        """Return the service engineer's picture: the operator's one with signals, cylinders, nodes and bus load."""
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
        """Return outlines [m]; None while an angle is missing. The chassis' pitch is not drawn."""
        theta = self._channels.read(sample.values)[: self._machine.size]
        if not np.isfinite(theta).all():
            return None
        drawing = outline(self._machine, theta)
        tool = complex(self._machine.tool_point(theta).place)
        shapes = {
            "links": drawing.links,
            "cylinders": drawing.cylinders,
            "rockers": drawing.rockers,
            "bars": drawing.bars,
        }
        drawn: Picture = {name: [_points(shape) for shape in parts] for name, parts in shapes.items()}
        return drawn | {"tool": _points([tool])[0], "reach": self._reach, "fresh": not any(sample.reasons)}

    def _check_zero(self, t_us: int) -> bool:
        """Return whether the zero was not set for too long; the time runs from the start of the display on."""
        self._begun_us = self._begun_us or t_us
        after_us = 60e6 * self._marks.check_zero_min
        return 0.0 < after_us < t_us - max(self._begun_us, self._listener.zeroed_us)

    def _rated(self, loading: Loading) -> float:
        """Return the rated payload [kg] with the chosen tool; 0 for an unknown one."""
        service, number = self._listener.service, loading.known.tool if loading.known else 0
        return service.fitted(service.tools[number]).machine.rated_payload if number < len(service.tools) else 0.0

    @property
    def _reach(self) -> float:
        """Return the largest distance of a point from the first pin [m]."""
        return float(sum(self._machine.lengths[:-1])) + abs(self._machine.tool)

    def _cylinders(self, sample: Sample, loading: Loading) -> list[Picture]:
        """Return the force of each cylinder [N] by its pressures, and the residual torque [N m] at its joint.

        The torque is None for a cylinder that acts on several joints.
        """
        force: Array = self._channels.read(sample.values)[self._channels.forces]
        residuals = dict(zip(self._machine.rows, loading.known.unexplained if loading.known else (), strict=False))
        return [
            {
                "name": cylinder.name,
                "force": _number(float(f)),
                "unexplained": residuals.get(span[0]) if len(span) == 1 else None,
            }
            for cylinder, span, f in zip(self._machine.cylinders, self._machine.spans, force, strict=True)
        ]


def _number(value: float) -> float | None:
    """Return a finite value, else None."""
    return value if isfinite(value) else None


def _points(shape: tuple[Place, ...] | list[Place]) -> list[tuple[float, float] | None]:
    """Return corners [m], rounded to millimetres; None where a linkage cannot be closed."""
    return [(round(z.real, 3), round(z.imag, 3)) if isfinite(abs(z)) else None for z in shape]


def _signal(signals: tuple[Signal, ...], sample: Sample, k: int, age: float) -> Picture:
    """Return a signal with its age [s] and the reason why it is not used."""
    value = _number(float(sample.values[k]))
    return {
        "name": signals[k].name,
        "value": value,
        "unit": signals[k].unit,
        "age_ms": round(1e3 * age) if isfinite(age) else None,
        "reason": int(sample.reasons[k]),
    }


def _quality(values: Mapping[str, float], name: str) -> tuple[int, int]:
    """Return status and reason of a published quality; INVALID and SILENT where nothing was received."""
    if name not in values:
        return int(Status.INVALID), SILENT
    byte = int(values[name])
    return byte & 3, byte >> 2


def _weight(values: Mapping[str, float]) -> Picture:
    """Return gross, net and standard error [kg]; None where the weight is invalid."""
    status, reason = _quality(values, names.PAYLOAD_QUALITY)
    published = {"gross": names.GROSS, "net": names.NET, "error": names.GROSS_ERROR}
    weight = {key: _number(values.get(name, float("nan"))) for key, name in published.items()}
    if status != Status.INVALID and None in weight.values():
        missing = any(name not in values for name in published.values())
        status, reason = int(Status.INVALID), SILENT if missing else int(Reason.OUT_OF_DECLARED_RANGE)
    if status == Status.INVALID:
        weight = dict.fromkeys(weight)
    return weight | {"status": status, "reason": reason}


def _force(values: Mapping[str, float], of: tuple[str, ...], errors: tuple[str, str]) -> Picture:
    """Return components, magnitude [N], direction [rad] and the components' standard errors; None where invalid.

    of: names of the four values
    errors: names of the two standard errors
    """
    status, reason = _quality(values, names.QUALITY[of[2]])
    keys = ("x", "z", "magnitude", "direction")
    force = {key: _number(values.get(name, float("nan"))) for key, name in zip(keys, of, strict=True)}
    force |= {f"error_{axis}": _number(values.get(name, float("nan"))) for axis, name in zip("xz", errors, strict=True)}
    if status == Status.INVALID:
        force = dict.fromkeys(force)
    return force | {"status": status, "reason": reason}


def _truck(loading: Loading, weight: Picture, red: float) -> Picture | None:
    """Return the truck with advice for loading; None while the service does not answer."""
    truck = loading.known
    return None if truck is None else truck._asdict() | {"loaded": truck.loaded} | _advice(loading, weight, red)


def _advice(loading: Loading, weight: Picture, red: float) -> Picture:
    """Return advice for loading the truck; None in all places without a target.

    share, with_bucket: share of the target in the truck, and with the bucket that was weighed
    remaining: [kg]
    last_bucket: whether the next bucket is the last one
    next_share: share of a mean bucket that it needs
    overloads: whether a mean bucket would overload, beyond `red` times the target
    tip_off: mass to tip off the bucket that was weighed [kg]
    """
    truck = loading.known
    if truck is None or truck.target <= 0.0:
        nothing = dict.fromkeys(("share", "with_bucket", "remaining", "next_share", "tip_off"))
        return nothing | {"last_bucket": False, "overloads": False}
    hanging, loaded = max(weight["net"] or 0.0, 0.0), truck.loaded
    remaining = truck.target - loaded
    mean_bucket = truck.total / truck.filled if truck.filled else None
    last = mean_bucket is not None and 0.0 < remaining <= LAST_SHARE * mean_bucket
    shares = {"share": loaded / truck.target, "with_bucket": (loaded + hanging) / truck.target}
    next_share = min(1.0, remaining / mean_bucket) if mean_bucket and mean_bucket > 0.0 and remaining > 0.0 else None
    tip_off = hanging - remaining if remaining > 0.0 and hanging > remaining else None
    overloads = mean_bucket is not None and loaded + mean_bucket > red * truck.target
    return shares | {
        "next_share": next_share,
        "tip_off": tip_off,
        "overloads": overloads,
        "remaining": remaining,
        "last_bucket": last,
    }
