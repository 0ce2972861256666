"""A machine's clean recordings, shared by its cases, and what a fault makes of them."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from reference_machine.datasheet import JOINTS
from reference_machine.engine import Trace
from reference_machine.machine import Machine, Stage, draw
from reference_machine.machinefile import TWO_LINK_SIGNALS, machine_file, two_link_file
from reference_machine.plan import Plan
from reference_machine.sensors import SIGNALS

from .fault import Fault, Scene, Stretch, same_physics

Array = NDArray[np.float64]
NAME = "Excavator"  # of every machine
LOAD_KG = 1000.0
PAUSE_S = 30.0  # between the field's recordings
EMPTY, LOADED = "field_empty", "field_loaded"


@dataclass(frozen=True)
class Lengths:
    """Durations [s] of the recordings."""

    reference_empty: float = 240.0
    reference_loaded: float = 90.0
    field_empty: float = 100.0
    field_loaded: float = 100.0


@dataclass(frozen=True)
class Piece:
    """A recording of the field before its sensors are read: the motion of the clean machine. `boom` (T,): planned
    lengths of the boom's cylinders [m], where the clean machine does not move them."""

    stretch: Stretch
    machine: Machine
    stage: Stage
    plan: Plan
    boom: Array | None = None

    @cached_property
    def clean(self) -> Trace:
        """The motion of the clean machine."""
        return self.machine.trace(self.plan, self.stage.pitch, self.stage.roll)

    def values(self, machine: Machine, seed: tuple[int, ...]) -> Array:
        """Readings (T, S) of a machine's sensors: commanded motion and noise are the same for all machines."""
        plan = machine.edited(self.plan)
        same = same_physics(machine, self.machine)
        trace = self.clean if same else machine.trace(plan, self.stage.pitch, self.stage.roll)
        return machine.measured(trace, plan, self.stage, np.random.default_rng([*seed, len(self.stretch.name)]))


class Site:
    """A drawn machine: reference recordings, made once, and the field's pieces."""

    signals, turns = SIGNALS, True

    def __init__(self, seed: int, friction: str, lengths: Lengths) -> None:
        self.seed, self.friction, self.lengths = seed, friction, lengths
        self.machine = draw(seed, friction=friction)

    @property
    def data_sheet(self) -> str:
        """The machine file; its name does not identify the machine."""
        return machine_file(NAME)

    @cached_property
    def two_links(self) -> "Site":
        """The same machine as a system of stick and bucket alone."""
        return TwoLinks(self.seed, self.friction, self.lengths)

    def shown(self, values: Array) -> Array:
        """The signals (T, S) that the machine file has, selected from all signals."""
        return values

    @cached_property
    def references(self) -> dict[str, Array]:
        """Values (T, S) of the clean machine, empty and with the known load."""
        return {
            "reference_empty": self._reference(0, self.lengths.reference_empty, 0.0),
            "reference_loaded": self._reference(1, self.lengths.reference_loaded, LOAD_KG),
        }

    def _reference(self, run: int, seconds: float, load: float) -> Array:
        stage = self.machine.stage("commissioning", seed=run, duration_s=seconds, slew=self.turns, payload_kg=load)
        plan = self.clean(stage.plans[0])
        trace = self.machine.trace(plan, stage.pitch, stage.roll)
        return self.shown(self.machine.measured(trace, plan, stage, stage.rng))

    def clean(self, plan: Plan) -> Plan:
        """The part of a plan that the clean machine carries out."""
        return plan

    @cached_property
    def pieces(self) -> tuple[Piece, ...]:
        """The field recordings of a case with good excitation: motions and slopes of its own."""
        return self.field(np.random.default_rng([self.seed, 5]), 2)

    def field(self, rng: np.random.Generator, run: int, poor: str = "") -> tuple[Piece, ...]:
        """A field; `poor` names what its motion lacks."""
        seconds = dict(zip((EMPTY, LOADED), (self.lengths.field_empty, self.lengths.field_loaded), strict=True))
        if poor == "short":
            seconds = dict.fromkeys(seconds, min(15.0, self.lengths.field_empty))
        if poor in ("empty_only", "no_load"):
            del seconds[LOADED]
        pieces: list[Piece] = []
        begin = 0.0
        for name, duration in seconds.items():
            pieces.append(self._piece(name, begin, duration, rng, run + len(pieces), poor))
            begin += duration + PAUSE_S
        return tuple(pieces)

    def _piece(self, name: str, begin: float, duration: float, rng: np.random.Generator, run: int, poor: str) -> Piece:
        load = LOAD_KG if name == LOADED else 0.0
        slope = {"pitch_deg": float(rng.uniform(-5.0, 5.0)), "roll_deg": float(rng.uniform(-3.0, 3.0))}
        stage = self.machine.stage(
            "commissioning",
            seed=run,
            duration_s=duration,
            oil_degc=40.0 + 0.0125 * begin,
            slew=self.turns and not poor,
            payload_kg=load,
            **slope,
        )
        (plan,) = stage.plans
        plan, boom = self.clean(lacking(plan, poor, int(rng.integers(3)))), plan.lengths[:, 0]
        stretch = Stretch(name, begin, duration, stage.pitch, stage.roll, load)
        return Piece(stretch, self.machine, stage, plan, None if self.turns else boom)


class TwoLinks(Site):
    """Stick and bucket alone, the boom as chassis: it stands still, its inclination is the pitch; no slewing."""

    signals, turns = TWO_LINK_SIGNALS, False

    @property
    def data_sheet(self) -> str:
        """The machine file of two links."""
        return two_link_file(NAME)

    def shown(self, values: Array) -> Array:
        """The tilt sensor sits on the boom."""
        columns = dict(zip(SIGNALS, values.T, strict=True))
        columns["pitch"] = columns["pitch"] + columns["boom_angle"]
        return np.stack([columns[name] for name in self.signals], axis=-1)

    def clean(self, plan: Plan) -> Plan:
        """The boom stays where it is at the begin."""
        lengths = plan.lengths.copy()
        lengths[:, 0] = lengths[0, 0]
        return replace(plan, lengths=lengths)


def lacking(plan: Plan, poor: str, joint: int) -> Plan:
    """A plan in which one joint moves alone, or all move six times slower."""
    lengths = plan.lengths
    if poor == "one_joint":
        lengths = np.tile(lengths[0], (plan.rows, 1))
        lengths[:, joint] = plan.lengths[:, joint]
    if poor == "slow":
        at = np.arange(plan.rows) / 6.0
        columns = [np.interp(at, np.arange(plan.rows), plan.lengths[:, k]) for k in range(len(JOINTS))]
        lengths = np.stack(columns, axis=-1)
    return replace(plan, lengths=lengths)


def scene(pieces: tuple[Piece, ...]) -> Scene:
    """The scene that effects are drawn for."""
    booms = {piece.stretch.name: piece.boom for piece in pieces if piece.boom is not None}
    return Scene(pieces[0].machine, tuple(piece.stretch for piece in pieces), booms)


def faulty(piece: Piece, faults: list[Fault]) -> Machine:
    """The piece's machine with all faults, one after the other."""
    machine = piece.machine
    for fault in faults:
        machine = fault.apply(machine, piece.stretch)
    return machine
