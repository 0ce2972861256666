"""A loader drawn from a seed, and its runs."""

from copy import deepcopy
from dataclasses import asdict, dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from reference_machine.arm import GRAVITY, up_vector
from reference_machine.engine import DT
from reference_machine.friction import Friction, PinFriction, draw_friction
from reference_machine.hydraulics import Hydraulics, draw_hydraulics
from reference_machine.machine import FRICTION, HYDRAULICS, RUN, SENSORS, SPECIMEN, plain, stream
from reference_machine.plan import PHASES, RATE
from reference_machine.recording import Recording
from reference_machine.sensors import LATEST, Sensors, draw_channel, parts
from reference_machine.truth import body_numbers

from .engine import TRUE_COLUMNS, Engine, Plant, Trace
from .geometry import Geometry
from .machinefile import INERTIAL, INERTIAL_NODES, INERTIAL_PDOS, NODES, PDOS, machine_file
from .sheet import CYLINDERS, JOINTS
from .site import Site
from .specimen import Specimen, draw_specimen
from .work import SCENARIOS, LoaderPlan

Array = NDArray[np.float64]
KIND = {
    **{f"{name}_{side}_pressure": "pressure" for name in CYLINDERS for side in ("head", "rod")},
    **{f"{joint}_angle": "angle" for joint in JOINTS},
    "pitch": "tilt",
    "roll": "tilt",
}
SIGNALS = tuple(KIND)
NODE = {field[0]: node for node, fields in INERTIAL_PDOS.items() for field in fields}
LIKE = ("boom", "stick")  # the excavator's joints whose friction is that of lift and tilt


@dataclass(frozen=True)
class Loader:
    """One loader; every part can be replaced (`dataclasses.replace`) before a run. `inertial`: whether its base has an
    inertial sensor."""

    seed: int
    specimen: Specimen
    friction: tuple[Friction, ...]
    pins: tuple[PinFriction | None, ...]
    sensors: Sensors
    hydraulics: Hydraulics
    friction_kind: str
    inertial: bool = False

    @property
    def name(self) -> str:
        """The name in its machine file."""
        return f"Reference loader {self.seed}"

    @cached_property
    def geometry(self) -> Geometry:
        """Its true geometry."""
        return Geometry(self.specimen)

    def run(
        self,
        scenario: str,
        *,
        seed: int = 0,
        pitch_deg: float | None = None,
        roll_deg: float | None = None,
        oil_degc: float = 40.0,
        name: str | None = None,
        **options: object,
    ) -> Recording:
        """The loader through a scenario (`work.SCENARIOS` has names and `options`); the rest as for the excavator.
        Raises ValueError for an unknown scenario."""
        if scenario not in SCENARIOS:
            raise ValueError(f"scenario is {scenario!r}: choose one of {', '.join(SCENARIOS)}")
        rng = stream(self.seed, RUN, seed)
        drawn = rng.uniform(-1.0, 1.0, 2) * (3.0, 2.0)
        given = (pitch_deg, roll_deg)
        pitch, roll = (float(np.radians(d if g is None else g)) for d, g in zip(drawn, given, strict=True))
        site = Site(self.geometry, rng, oil_degc)
        plan = SCENARIOS[scenario](site, **options)
        plan = replace(plan, kelvin=site.kelvin(plan.rows))
        plant = Plant(
            self.specimen, deepcopy(list(self.friction)), deepcopy(list(self.pins)), self.hydraulics, pitch, roll
        )
        trace = Engine(plant, plan).run()
        names = tuple(channel.name for channel in self.sensors.channels)
        seen = signals_of(self.specimen, trace.fast, pitch, roll)[:, : len(names)]
        values = self.sensors.measure(seen, plan.kelvin, 0, rng)
        t_s = np.arange(plan.rows) / RATE
        header = self.describe() | {
            "scenario": scenario,
            "run_seed": seed,
            "options": {key: plain(v) for key, v in options.items()},
            "pitch": pitch,
            "roll": roll,
            "phases": list(PHASES),
            "pieces": [{"begin_s": 0.0, "rows": plan.rows} | plan.notes],
        }
        truth = _truth(trace, plan)
        sheet = machine_file(self.name, inertial=self.inertial)
        bus = (INERTIAL_NODES, INERTIAL_PDOS) if self.inertial else (NODES, PDOS)
        return Recording(name or scenario, t_s, names, values, truth, header, sheet, *bus)

    def describe(self) -> dict[str, object]:
        """What the loader really is, for the truth file; SI units."""
        s = self.specimen
        return {
            "machine_name": self.name,
            "machine_seed": self.seed,
            "friction_kind": self.friction_kind,
            "links": {j: body_numbers(s.bodies[j]) | {"length": s.lengths[j]} for j in JOINTS},
            "linkage_bodies": {key: asdict(bar) for key, bar in s.bars.items()},
            "tool": list(s.tool),
            "cylinders": {c: asdict(s.cylinders[c]) | {"areas": list(s.areas(c))} for c in CYLINDERS},
            "zbar": asdict(s.zbar),
            "friction": {c: f.numbers() for c, f in zip(CYLINDERS, self.friction, strict=True)},
            "pin_friction": {j: p.numbers() for j, p in zip(JOINTS, self.pins, strict=True) if p},
            "sensors": {channel.name: channel.numbers() for channel in self.sensors.channels},
            "hydraulics": asdict(self.hydraulics),
        }


def draw(
    seed: int,
    *,
    friction: str = "own",
    sensors: str = "class",
    masses: bool = True,
    geometry: bool = True,
    inertial: bool = False,
) -> Loader:
    """Loader number `seed`, with an `inertial` sensor or without; other arguments as for the excavator. Raises
    ValueError."""
    rng, seen, on = stream(seed, FRICTION), stream(seed, SENSORS), parts(sensors)
    pairs = [draw_friction(friction, like, rng, DT) for like in LIKE]
    skew = {node: float(seen.uniform(0.0, LATEST)) for node in INERTIAL_NODES}
    kinds = KIND | INERTIAL if inertial else KIND
    channels = tuple(draw_channel(name, kind, skew[NODE[name]], seen, on) for name, kind in kinds.items())
    return Loader(
        seed=seed,
        specimen=draw_specimen(stream(seed, SPECIMEN), masses=masses, geometry=geometry),
        friction=tuple(pair[0] for pair in pairs),
        pins=tuple(pair[1] for pair in pairs),
        sensors=Sensors(channels),
        hydraulics=draw_hydraulics(stream(seed, HYDRAULICS)),
        friction_kind=friction,
        inertial=inertial,
    )


def signals_of(specimen: Specimen, fast: Array, pitch: float, roll: float) -> Array:
    """True signals (10 T, S) at 1 kHz, those of the inertial sensor last: its specific force is that against gravity,
    driving, and rocking about the wheels."""
    drive, rock, rate, turn = fast[:, 6:10].T
    x, _, z = up_vector(pitch, roll)
    outside = (GRAVITY * (x + 1j * z) + drive) * np.exp(-1j * rock)
    arm = complex(*specimen.sheet.inertial) - complex(*specimen.sheet.wheels)
    specific = outside + (1j * turn - rate**2) * arm
    return np.column_stack([fast[:, :6], pitch + rock, np.full(len(fast), roll), rate, specific.real, specific.imag])


def _truth(trace: Trace, plan: LoaderPlan) -> dict[str, Array]:
    """Truth (T,) by name."""
    found = dict(zip(TRUE_COLUMNS, trace.true.T, strict=True))
    mass, x, z, gyration = plan.payload.T
    found |= {"payload": mass, "payload_x": x, "payload_z": z, "payload_gyration": gyration}
    return found | {"oil": plan.kelvin, "wear": plan.wear, "phase": plan.phase, "cycle": plan.cycle}
