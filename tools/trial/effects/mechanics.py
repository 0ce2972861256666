"""Effects of bodies, pins and loads on the reference machine."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from reference_machine.datasheet import JOINTS
from reference_machine.machine import Machine
from reference_machine.plan import RATE, Plan, smooth

from .fault import Draw, Fault, Scene, Stretch

Array = NDArray[np.float64]
EXTRA = {"boom": (80.0, 400.0), "stick": (40.0, 250.0), "bucket": (40.0, 250.0)}  # kg
PLACES = {
    "boom": ("foot", "eye"),
    "stick": ("foot", "eye"),
    "bucket": ("foot", "rocker_pin", "link_pin", "rocker", "link"),
}


def linkage_geometry(draw: Draw, scene: Scene) -> Fault:
    """A pin or a bar 5-30 mm off."""
    at, size, way = draw.one(JOINTS), draw.size(5e-3, 30e-3), draw.ray()
    part = draw.one(PLACES[at])

    def apply(machine: Machine, _: Stretch) -> Machine:
        s = machine.specimen
        step = size * way
        if part in ("foot", "eye"):
            cylinder = s.cylinders[at]
            change: dict[str, Any] = {part: _moved(getattr(cylinder, part), step)}
            return replace(machine, specimen=replace(s, cylinders=s.cylinders | {at: replace(cylinder, **change)}))
        bars, old = s.bucket_bars, getattr(s.bucket_bars, part)
        new = _moved(old, step) if isinstance(old, tuple) else old + float(np.copysign(size, way[0]))
        change = {part: new}
        return replace(machine, specimen=replace(s, bucket_bars=replace(bars, **change)))

    return Fault("linkage_geometry", at, size, "m", apply, part)


def _moved(point: tuple[float, float], step: Array) -> tuple[float, float]:
    return point[0] + float(step[0]), point[1] + float(step[1])


def extra_mass(draw: Draw, scene: Scene) -> Fault:
    """A lump near a link's centre of gravity."""
    at = draw.one(JOINTS)
    size = draw.size(*EXTRA[at])
    x, z = (draw.uniform(0.0, 0.3) * draw.ray()).tolist()

    def apply(machine: Machine, _: Stretch) -> Machine:
        s = machine.specimen
        body = s.bodies[at]
        mass = body.mass + size
        share = size / mass
        centre = _moved(body.centre, np.array([share * x, share * z]))
        reduced = body.mass * share
        heavier = replace(
            body,
            mass=mass,
            centre=centre,
            xx=body.xx + reduced * x * x,
            zz=body.zz + reduced * z * z,
            xz=body.xz + reduced * x * z,
        )
        return replace(machine, specimen=replace(s, bodies=s.bodies | {at: heavier}))

    return Fault("extra_mass", at, size, "kg", apply, "lump")


def first_moment(draw: Draw, scene: Scene) -> Fault:
    """A link's centre of gravity 30-250 mm elsewhere."""
    at, size, way = draw.one(JOINTS), draw.size(0.03, 0.25), draw.ray()

    def apply(machine: Machine, _: Stretch) -> Machine:
        s = machine.specimen
        body = replace(s.bodies[at], centre=_moved(s.bodies[at].centre, size * way))
        return replace(machine, specimen=replace(s, bodies=s.bodies | {at: body}))

    moment = size * scene.machine.specimen.bodies[at].mass
    return Fault("first_moment_change", at, moment, "kg m", apply, f"{np.degrees(np.arctan2(way[1], way[0])):.0f} deg")


def with_edit(machine: Machine, edit: Callable[[Plan], Plan]) -> Machine:
    """The machine with a further edit of its plans."""
    return replace(machine, edits=(*machine.edits, edit))


def soil_contact(draw: Draw, scene: Scene) -> Fault:
    """Contact of the teeth with soil where none is expected: a few rough pulses of 3-20 kN, 0.4-6 s each."""
    size, seed = draw.size(3e3, 20e3), int(draw.rng.integers(2**31))

    def apply(machine: Machine, stretch: Stretch) -> Machine:
        def edit(plan: Plan) -> Plan:
            rng = np.random.default_rng([seed, len(stretch.name)])
            return replace(plan, tip=plan.tip + _pulses(rng, plan.rows, size))

        return with_edit(machine, edit)

    return Fault("soil_contact", "bucket", size, "N", apply, "pulses")


def _pulses(rng: np.random.Generator, rows: int, size: float) -> Array:
    """Forces (T, 2): up, and forward or back."""
    t, total = np.arange(rows) / RATE, np.zeros((rows, 2))
    for _ in range(int(rng.integers(1, 9))):
        width = float(rng.uniform(0.4, 6.0))
        begin = float(rng.uniform(2.0, max(rows / RATE - width - 1.0, 2.5)))
        rough = np.convolve(
            rng.standard_normal(rows + 20), np.hanning(21) / np.sqrt(np.sum(np.hanning(21) ** 2)), "valid"
        )
        on = smooth((t - begin) / 0.15) * (1.0 - smooth((t - begin - width) / 0.2)) * (1.0 + 0.15 * rough)
        way = float(np.radians(rng.uniform(30.0, 150.0)))
        total += size * float(rng.uniform(0.6, 1.2)) * on[:, None] * np.array([np.cos(way), np.sin(way)])
    return total


def since(plan: Plan, when: float, takes: float) -> Array:
    """0 to 1 (T,) within `takes` [s], from where a share `when` of the time with a load in the bucket has passed; until
    the end of that load."""
    mass = plan.payload[:, 0]
    loaded = np.flatnonzero(mass > 0.9 * mass.max())
    begin = int(loaded[int(when * (len(loaded) - 1))])
    same = plan.cycle == plan.cycle[begin]
    return np.asarray(same * smooth((np.arange(plan.rows) - begin) / (RATE * takes)))


def payload_shift(draw: Draw, scene: Scene) -> Fault:
    """The load slides 0.1-0.5 m at an instant."""
    size, way = draw.size(0.1, 0.5), draw.ray()
    when, takes = draw.uniform(0.25, 0.75), draw.shape(0.15, 4.0)

    def apply(machine: Machine, stretch: Stretch) -> Machine:
        if not stretch.payload_kg:
            return machine

        def edit(plan: Plan) -> Plan:
            payload = plan.payload.copy()
            payload[:, 1:3] += since(plan, when, takes)[:, None] * size * way
            return replace(plan, payload=payload)

        return with_edit(machine, edit)

    return Fault("payload_shift", "bucket", size, "m", apply, "slide")


def payload_spill(draw: Draw, scene: Scene) -> Fault:
    """5-50 % of the load falls within 0.3-15 s."""
    size, when, takes = draw.size(0.05, 0.5), draw.uniform(0.25, 0.75), draw.shape(0.3, 15.0)

    def apply(machine: Machine, stretch: Stretch) -> Machine:
        if not stretch.payload_kg:
            return machine

        def edit(plan: Plan) -> Plan:
            payload = plan.payload.copy()
            payload[:, 0] *= 1.0 - size * since(plan, when, takes)
            return replace(plan, payload=payload)

        return with_edit(machine, edit)

    return Fault("payload_spill", "bucket", size, "of load", apply, "falls")


def boom_motion(draw: Draw, scene: Scene) -> Fault:
    """The boom moves under a system that takes it for its chassis, at 20-100 % of an operator's speed."""
    share = min(draw.size(0.2, 1.0), 1.0)

    def apply(machine: Machine, stretch: Stretch) -> Machine:
        def edit(plan: Plan) -> Plan:
            lengths = plan.lengths.copy()
            lengths[:, 0] += share * (scene.booms[stretch.name] - lengths[0, 0])
            return replace(plan, lengths=lengths)

        return with_edit(machine, edit)

    fastest = max(float(np.abs(np.diff(boom)).max()) for boom in scene.booms.values()) * RATE
    return Fault("boom_motion", "machine", share * fastest, "m/s", apply)
