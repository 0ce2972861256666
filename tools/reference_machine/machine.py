"""A machine drawn from a seed, and its runs."""

from collections.abc import Callable, Iterable
from copy import deepcopy
from dataclasses import asdict, dataclass, is_dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .arm import tilt
from .datasheet import JOINTS
from .engine import DT, TRUE_COLUMNS, Engine, ExtraTorque, Plant, Trace
from .friction import Friction, PinFriction, draw_friction
from .geometry import Geometry
from .hydraulics import Hydraulics, draw_hydraulics
from .plan import PHASES, RATE, Plan
from .recording import Recording
from .scenarios import SCENARIOS
from .sensors import SIGNALS, Sensors, draw_sensors, parts
from .site import Site
from .specimen import Specimen, draw_specimen
from .truth import body_numbers, effective_parameters, links_parameters, slew_parameters

Array = NDArray[np.float64]
SPECIMEN, FRICTION, SENSORS, HYDRAULICS, RUN, TRUTH = range(6)  # one stream of random numbers each


def stream(seed: int, *path: int) -> np.random.Generator:
    """Random numbers for one purpose."""
    return np.random.default_rng([seed, *path])


@dataclass(frozen=True)
class Stage:
    """A run that is planned but not yet carried out: `plans`, the slope [rad], and the stream of random numbers that
    the sensors' noise comes from. A machine with an effect that runs on the stage of the machine without it gets the
    same commands and the same noise."""

    plans: list[Plan]
    pitch: float
    roll: float
    rng: np.random.Generator


@dataclass(frozen=True)
class Machine:
    """One machine; every part can be replaced (`dataclasses.replace`) before a run.

    Effects come in by replacing parts, by `extra` torques on the arm, by `edits` of what is to happen (a payload that
    spills, friction that wears, ground that rises), and by the sensors' distortions. `friction_kind` is only a name."""

    seed: int
    specimen: Specimen
    friction: tuple[Friction, ...]
    pins: tuple[PinFriction | None, ...]
    sensors: Sensors
    hydraulics: Hydraulics
    friction_kind: str
    extra: tuple[ExtraTorque, ...] = ()
    edits: tuple[Callable[[Plan], Plan], ...] = ()

    @property
    def name(self) -> str:
        """The name in its machine file."""
        return f"Reference excavator {self.seed}"

    @cached_property
    def geometry(self) -> Geometry:
        """Its true geometry."""
        return Geometry(self.specimen)

    def run(
        self,
        scenario: str,
        *,
        seed: int = 0,
        duration_s: float | None = None,
        pitch_deg: float | None = None,
        roll_deg: float | None = None,
        oil_degc: float = 40.0,
        oil_degc_per_s: float = 0.0125,
        wear: float = 1.0,
        name: str | None = None,
        **options: object,
    ) -> Recording:
        """The machine through a scenario (see `scenarios.SCENARIOS` for names and `options`).

        `pitch_deg`, `roll_deg`: the slope when the house looks ahead, by default drawn within 3 and 2 degrees; the oil
        starts at `oil_degc` and warms by `oil_degc_per_s` except in warm_up; `wear` is a factor of all friction. The
        same seeds give the same recording. Raises ValueError for an unknown scenario or option."""
        stage = self.stage(
            scenario,
            seed=seed,
            duration_s=duration_s,
            pitch_deg=pitch_deg,
            roll_deg=roll_deg,
            oil_degc=oil_degc,
            oil_degc_per_s=oil_degc_per_s,
            wear=wear,
            **options,
        )
        plans = [self.edited(plan) for plan in stage.plans]
        pieces = [self._piece(plan, stage) for plan in plans]
        t_s, values = (np.concatenate([piece[k] for piece in pieces]) for k in (0, 1))
        truth = {key: np.concatenate([piece[2][key] for piece in pieces]) for key in pieces[0][2]}
        header = self.describe() | {
            "scenario": scenario,
            "run_seed": seed,
            "options": {key: plain(v) for key, v in options.items()},
            "pitch": stage.pitch,
            "roll": stage.roll,
            "phases": list(PHASES),
            "pieces": [{"begin_s": p.begin, "rows": p.rows + round(p.still_s * RATE)} | p.notes for p in plans],
        }
        return Recording(name or scenario, t_s, SIGNALS, values, truth, header)

    def stage(
        self,
        scenario: str,
        *,
        seed: int = 0,
        duration_s: float | None = None,
        pitch_deg: float | None = None,
        roll_deg: float | None = None,
        oil_degc: float = 40.0,
        oil_degc_per_s: float = 0.0125,
        wear: float = 1.0,
        **options: object,
    ) -> Stage:
        """What `run` would do, planned on this machine's geometry; arguments as there."""
        rng = stream(self.seed, RUN, seed)
        slope = [float(x) for x in rng.uniform(-1.0, 1.0, 2) * (3.0, 2.0)]
        slope = [drawn if given is None else given for drawn, given in zip(slope, (pitch_deg, roll_deg), strict=True)]
        site = Site(self.geometry, rng, oil_degc, oil_degc_per_s)
        plans = [_conditioned(site, plan, wear) for plan in _plans(site, scenario, duration_s, options)]
        pitch, roll = (float(np.radians(x)) for x in slope)
        return Stage(plans, pitch, roll, rng)

    def plant(self, pitch: float = 0.0, roll: float = 0.0) -> Plant:
        """A fresh set of physics on a slope [rad]."""
        friction, pins = deepcopy(list(self.friction)), deepcopy(list(self.pins))
        return Plant(self.specimen, friction, pins, self.hydraulics, pitch, roll, self.extra)

    def edited(self, plan: Plan) -> Plan:
        """The plan after the machine's edits."""
        for edit in self.edits:
            plan = edit(plan)
        return plan

    def trace(self, plan: Plan, pitch: float, roll: float) -> Trace:
        """Motion and pressures of the machine under an edited plan."""
        return Engine(self.plant(pitch, roll), plan).run()

    def measured(self, trace: Trace, plan: Plan, stage: Stage, rng: np.random.Generator) -> Array:
        """Sensor readings (T, S) of a trace."""
        still = round(plan.still_s * RATE)
        kelvin = np.concatenate([plan.kelvin, np.full(still, plan.kelvin[-1])])
        return self.sensors.measure(signals_of(trace.fast, stage.pitch, stage.roll), kelvin, still, rng)

    def _piece(self, plan: Plan, stage: Stage) -> tuple[Array, Array, dict[str, Array]]:
        """Times, values and truth of one plan."""
        trace = self.trace(plan, stage.pitch, stage.roll)
        still = round(plan.still_s * RATE)
        values = self.measured(trace, plan, stage, stage.rng)
        found = _truth(trace, plan, stage.pitch, stage.roll)
        truth = {key: np.concatenate([x, np.full(still, x[-1])]) for key, x in found.items()}
        return plan.begin + np.arange(len(values)) / RATE, values, truth

    def describe(self) -> dict[str, object]:
        """What the machine really is, for the truth file; SI units."""
        s = self.specimen
        fitted, left = self._parameters
        return {
            "machine_name": self.name,
            "machine_seed": self.seed,
            "friction_kind": self.friction_kind,
            "base_parameters": fitted | slew_parameters(s, fitted),
            "base_parameters_rms_nm": dict(zip(JOINTS, left, strict=True)),
            "base_parameters_of_links_alone": links_parameters(s),
            "links": {j: body_numbers(s.bodies[j]) | {"length": s.lengths[j]} for j in JOINTS},
            "linkage_bodies": {key: asdict(bar) for key, bar in s.bars.items()},
            "tool": list(s.tool),
            "slew_axis": s.slew_axis,
            "cylinders": {j: asdict(s.cylinders[j]) | {"areas": list(s.areas(j))} for j in JOINTS},
            "bucket_bars": asdict(s.bucket_bars),
            "friction": {j: f.numbers() for j, f in zip(JOINTS, self.friction, strict=True)},
            "pin_friction": {j: p.numbers() for j, p in zip(JOINTS, self.pins, strict=True) if p},
            "sensors": {channel.name: channel.numbers() for channel in self.sensors.channels},
            "hydraulics": asdict(self.hydraulics),
        }

    @cached_property
    def _parameters(self) -> tuple[dict[str, float], list[float]]:
        fitted, left = effective_parameters(self.specimen, stream(self.seed, TRUTH))
        return fitted, left.tolist()


def draw(
    seed: int,
    *,
    friction: str = "own",
    sensors: str | Iterable[str] = "class",
    masses: bool = True,
    geometry: bool = True,
    linkage_masses: bool = True,
) -> Machine:
    """Machine number `seed` of the model.

    `friction`: own, foreign or none; `sensors`: class, perfect, or the parts of their errors that are on
    (sensors.PARTS); `masses`, `geometry` False: exactly the data sheet's; `linkage_masses` False: cylinders and bucket
    bars weigh nothing, their mass is in the links. A seed draws each part the same whatever the others are. Raises
    ValueError."""
    specimen = draw_specimen(stream(seed, SPECIMEN), masses=masses, geometry=geometry, linkage_masses=linkage_masses)
    rng = stream(seed, FRICTION)
    pairs = [draw_friction(friction, joint, rng, DT) for joint in JOINTS]
    return Machine(
        seed=seed,
        specimen=specimen,
        friction=tuple(pair[0] for pair in pairs),
        pins=tuple(pair[1] for pair in pairs),
        sensors=draw_sensors(stream(seed, SENSORS), parts(sensors)),
        hydraulics=draw_hydraulics(stream(seed, HYDRAULICS)),
        friction_kind=friction,
    )


def plain(option: object) -> object:
    """An option as JSON knows it."""
    if is_dataclass(option) and not isinstance(option, type):
        return asdict(option)
    return list(option) if isinstance(option, tuple) else option


def _plans(site: Site, scenario: str, duration_s: float | None, options: dict[str, object]) -> list[Plan]:
    if scenario not in SCENARIOS:
        raise ValueError(f"scenario is {scenario!r}: choose one of {', '.join(SCENARIOS)}")
    given = options if duration_s is None else {"duration_s": duration_s, **options}
    try:
        return SCENARIOS[scenario](site, **given)
    except TypeError as error:
        raise ValueError(f"scenario {scenario}: {error}") from error


def _conditioned(site: Site, plan: Plan, wear: float) -> Plan:
    """The plan with the oil's temperature, unless it has its own, and the wear."""
    own = bool(plan.kelvin[0] > 0.0)
    return replace(plan, kelvin=plan.kelvin if own else site.kelvin(plan.begin, plan.rows), wear=plan.wear * wear)


def signals_of(fast: Array, pitch: float, roll: float) -> Array:
    """True signals (10 T, S) at 1 kHz."""
    tilts = np.array([tilt(pitch, roll, slew) for slew in fast[::10, 9].tolist()])
    grid, rows = np.arange(len(fast)), np.arange(len(tilts)) * 10
    house = [np.interp(grid, rows, column) for column in tilts.T]
    return np.column_stack([fast[:, :9], *house, fast[:, 10]])


def _truth(trace: Trace, plan: Plan, pitch: float, roll: float) -> dict[str, Array]:
    """Truth (T,) by name."""
    found = dict(zip(TRUE_COLUMNS, trace.true.T, strict=True))
    for j in JOINTS:
        pushed = found[f"force.{j}"] - found[f"friction.{j}"]
        found[f"torque.{j}"] = pushed * found[f"lever.{j}"] - found[f"pin_torque.{j}"]
    house = np.array([tilt(pitch, roll, slew) for slew in found["slew"].tolist()])
    found["pitch"], found["roll"] = house.T
    c, s = np.cos(house[:, 0]), np.sin(house[:, 0])
    for what in ("tip", "tip_force"):
        x, z = found[f"{what}_x"], found[f"{what}_z"]
        found[f"{what}_horizontal"], found[f"{what}_vertical"] = x * c - z * s, x * s + z * c
    mass, x, z, gyration = plan.payload.T
    found |= {"payload": mass, "payload_x": x, "payload_z": z, "payload_gyration": gyration}
    return found | {"oil": plan.kelvin, "wear": plan.wear, "phase": plan.phase, "cycle": plan.cycle}
