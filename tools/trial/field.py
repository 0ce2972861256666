"""A machine's clean recordings, shared by its cases, and what a fault makes of them."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from reference_machine.datasheet import JOINTS
from reference_machine.engine import Trace
from reference_machine.machine import Machine, Stage, draw
from reference_machine.machinefile import TWO_LINK_SIGNALS, machine_file, two_link_file
from reference_machine.plan import RATE, Plan
from reference_machine.sensors import SIGNALS

from .effects.fault import Fault, Scene, Stretch, same_physics
from .motion import quiet, stage, standing
from .repertoire import USUAL, Repertoire, Ride, drawn, noisier

Array = NDArray[np.float64]
NAME = "Excavator"  # of every machine
PAUSE_S = 30.0  # between the field's recordings
POOR_S = 15.0  # of a field that is short
CARRIED = ("payload_shift", "payload_spill")  # effects of a load, which the field must then have
TURNED = ("slew_centrifugal",)  # effects of slewing


@dataclass(frozen=True)
class Weather:
    """Conditions of a field recording.

    degc:                oil temperature at its begin [degC]
    pitch_deg, roll_deg: largest inclinations of the ground [deg]
    """

    degc: float = 40.0
    pitch_deg: float = 5.0
    roll_deg: float = 3.0


USUAL_WEATHER = Weather()
HARSH = Weather(degc=8.0, pitch_deg=12.0, roll_deg=7.0)  # a winter morning on a slope


@dataclass(frozen=True)
class Piece:
    """A recording before its sensors are read: the motion of the clean machine. `boom` (T,): planned lengths of the
    boom's cylinders [m], where the clean machine does not move them."""

    stretch: Stretch
    machine: Machine
    stage: Stage
    plan: Plan
    boom: Array | None = None

    @property
    def quiet(self) -> NDArray[np.bool_]:
        """Whether nothing that the diagnosis does not know acts on the arm (T,)."""
        return quiet(self.plan, known="loaded" in self.stretch.name)

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
    """A drawn machine: reference recordings, made once, and the field's pieces. `share` of the usual durations."""

    signals, turns = SIGNALS, True

    def __init__(self, seed: int, friction: str, share: float = 1.0, repertoire: Repertoire | None = None) -> None:
        self.seed, self.friction, self.share = seed, friction, share
        self.repertoire = repertoire or drawn(seed)
        self.machine = noisier(draw(seed, friction=friction), self.repertoire.noise)

    @property
    def data_sheet(self) -> str:
        """The machine file; its name does not identify the machine."""
        return machine_file(NAME)

    @cached_property
    def two_links(self) -> "Site":
        """The same machine as a system of stick and bucket alone."""
        return TwoLinks(self.seed, self.friction, self.share, self.repertoire)

    def shown(self, values: Array) -> Array:
        """The signals (T, S) that the machine file has, selected from all signals."""
        return values

    @cached_property
    def references(self) -> dict[str, Array]:
        """Values (T, S) of the clean machine."""
        pieces = enumerate(self.reference_pieces)
        return {p.stretch.name: self.shown(p.values(p.machine, (self.seed, 99, k))) for k, p in pieces}

    @cached_property
    def reference_pieces(self) -> tuple[Piece, ...]:
        """The motion of the references."""
        return tuple(self._piece(ride, 0.0, None, run) for run, ride in enumerate(self.repertoire.references))

    def clean(self, plan: Plan) -> Plan:
        """The part of a plan that the clean machine carries out."""
        return plan

    @cached_property
    def pieces(self) -> tuple[Piece, ...]:
        """The field recordings of a case with motions and slopes of the machine's own."""
        return self.field(self.repertoire.field, np.random.default_rng([self.seed, 5]), 20)

    @cached_property
    def usual(self) -> tuple[Piece, ...]:
        """Strokes, empty and with a load, and slewing: for effects that the other pieces could not show."""
        return self.field(USUAL, np.random.default_rng([self.seed, 6]), 30)

    @cached_property
    def harsh(self) -> tuple[Piece, ...]:
        """The motions of the field by a healthy machine in harsh conditions."""
        return self.field(self.repertoire.field, np.random.default_rng([self.seed, 9]), 40, weather=HARSH)

    def showing(self, names: tuple[str, ...]) -> tuple[Piece, ...]:
        """The field of a case with effects of these names."""
        loaded = any(piece.stretch.payload_kg for piece in self.pieces)
        turning = any(np.ptp(piece.plan.slew) > 0.0 for piece in self.pieces)
        lacks = (not loaded and set(CARRIED) & set(names)) or (not turning and set(TURNED) & set(names))
        return self.usual if lacks else self.pieces

    def poor(self, rng: np.random.Generator, run: int, poor: str) -> tuple[Piece, ...]:
        """The usual field of a case, whose motion lacks what `poor` names."""
        rides = tuple(ride for ride in USUAL if poor not in ("empty_only", "no_load") or not ride.load_kg)
        if poor == "short":
            rides = tuple(replace(ride, seconds=POOR_S / self.share) for ride in rides)
        return self.field(rides, rng, run, poor)

    def field(
        self,
        rides: tuple[Ride, ...],
        rng: np.random.Generator,
        run: int,
        poor: str = "",
        weather: Weather = USUAL_WEATHER,
    ) -> tuple[Piece, ...]:
        """Rides one after the other."""
        pieces: list[Piece] = []
        begin = 0.0
        for ride in rides:
            pieces.append(self._piece(ride, begin, rng, run + len(pieces), poor, weather))
            begin += pieces[-1].plan.rows / RATE + PAUSE_S
        return tuple(pieces)

    def _piece(
        self,
        ride: Ride,
        begin: float,
        rng: np.random.Generator | None,
        run: int,
        poor: str = "",
        weather: Weather = USUAL_WEATHER,
    ) -> Piece:
        """A ride; with random numbers on a slope of its own, else on one that is drawn with the run."""
        slope = None if rng is None else (_either_way(rng, weather.pitch_deg), _either_way(rng, weather.roll_deg))
        made = stage(
            self.machine,
            self.kind(ride),
            self.share * ride.seconds,
            run,
            slope=slope,
            degc=weather.degc + 0.0125 * begin,
            load_kg=ride.load_kg,
            slew=self.turns and not poor,
        )
        (plan,) = made.plans
        joint = 0 if rng is None else int(rng.integers(3))
        plan, boom = self.clean(lacking(plan, poor, joint)), plan.lengths[:, 0]
        load = float(plan.payload[:, 0].max())
        stretch = Stretch(ride.name, begin, plan.rows / RATE, made.pitch, made.roll, load)
        return Piece(stretch, self.machine, made, plan, None if self.turns else boom)

    def kind(self, ride: Ride) -> str:
        """The kind of motion that the machine makes of a ride."""
        return ride.kind


def _either_way(rng: np.random.Generator, largest: float) -> float:
    return float(rng.uniform(-largest, largest))


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
        return standing(plan)

    def kind(self, ride: Ride) -> str:
        """Nobody digs without the boom."""
        return "strokes" if ride.kind == "work" else ride.kind


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
