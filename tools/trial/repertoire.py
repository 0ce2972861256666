"""What is drawn for a machine of the trial: which references there are, what the field does, how noisy the sensors
are."""

from dataclasses import dataclass, replace

import numpy as np

from reference_machine.machine import Machine

LOAD_KG = 1000.0
EMPTY, LOADED, WORK = "field_empty", "field_loaded", "field_work"
NO_REFERENCE, ONE_MINUTE = 0.08, 0.14  # shares of the machines without a reference, and with a minute of strokes only
REFERENCES = ("strokes", "stairs", "sines", "work", "loaded")
REFERENCE_S, FIELD_S = (45.0, 240.0), (60.0, 180.0)
FIELDS = {"strokes": 0.35, "sines": 0.25, "stairs": 0.1, "work": 0.3}  # shares of the machines
WITH_LOAD = 0.6  # of the fields that are no work
NOISE = (0.5, 3.0)  # times that of the data sheet


@dataclass(frozen=True)
class Ride:
    """A recording to be made: its name, the kind of motion, how long [s], with which load [kg]."""

    name: str
    kind: str
    seconds: float
    load_kg: float = 0.0


@dataclass(frozen=True)
class Repertoire:
    """References and field of a machine, and the factor of its sensors' noise."""

    references: tuple[Ride, ...]
    field: tuple[Ride, ...]
    noise: float


USUAL = (Ride(EMPTY, "strokes", 100.0), Ride(LOADED, "strokes", 100.0, LOAD_KG))
PLAIN = Repertoire(  # plenty of everything: for studies that ask something else
    (Ride("reference_empty", "strokes", 240.0), Ride("reference_loaded", "strokes", 90.0, LOAD_KG)), USUAL, 1.0
)


def drawn(seed: int) -> Repertoire:
    """The repertoire of a machine."""
    rng = np.random.default_rng([seed, 21])
    return Repertoire(_references(rng), _field(rng), _between(rng, NOISE))


def _references(rng: np.random.Generator) -> tuple[Ride, ...]:
    what = rng.uniform()
    if what < NO_REFERENCE:
        return ()
    if what < NO_REFERENCE + ONE_MINUTE:
        return (Ride("reference_strokes", "strokes", 60.0),)
    kinds = rng.choice(REFERENCES, int(rng.integers(1, 5)), replace=False).tolist()
    return tuple(_reference(kind, _between(rng, REFERENCE_S)) for kind in kinds)


def _reference(kind: str, seconds: float) -> Ride:
    if kind == "loaded":
        return Ride("reference_loaded", "strokes", seconds, LOAD_KG)
    return Ride(f"reference_{kind}", kind, seconds)


def _field(rng: np.random.Generator) -> tuple[Ride, ...]:
    kind = str(rng.choice(list(FIELDS), p=list(FIELDS.values())))
    if kind == "work":
        return (Ride(WORK, kind, _between(rng, FIELD_S)),)
    loaded = (Ride(LOADED, kind, _between(rng, FIELD_S), LOAD_KG),) if rng.uniform() < WITH_LOAD else ()
    return (Ride(EMPTY, kind, _between(rng, FIELD_S)), *loaded)


def _between(rng: np.random.Generator, ends: tuple[float, float]) -> float:
    return float(np.exp(rng.uniform(*np.log(ends))))


def noisier(machine: Machine, factor: float) -> Machine:
    """The machine with so many times the noise in its sensors."""
    channels = tuple(replace(channel, noise=factor * channel.noise) for channel in machine.sensors.channels)
    return replace(machine, sensors=replace(machine.sensors, channels=channels))
