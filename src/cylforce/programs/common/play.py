"""A run of the simulated machine, ready to be played into files or onto a bus."""

import tomllib
from collections.abc import Iterable, Iterator
from math import inf
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, JsonValue, ValidationError
from pydantic_core import ErrorDetails

from cylforce.effects.imposed import Imposed, imposed
from cylforce.effects.library import LIBRARY, Group
from cylforce.files.atomic import LARGEST, is_large, is_stream
from cylforce.files.truth import describe_truth
from cylforce.mechanics.installation import Service
from cylforce.programs.experiments.motions import read_scene
from cylforce.settings.error import FaultError, Source, error_text, line_of
from cylforce.settings.machine_file import Loaded, SettingsError
from cylforce.settings.sections import fault
from cylforce.signals.kinds import Kind
from cylforce.simulation.scenario import cycles as digging_cycles
from cylforce.simulation.scenario import moves
from cylforce.simulation.sensing import Record, Sensors, run, sensors
from cylforce.simulation.simulator import Truth, draw_truth
from cylforce.simulation.trajectory import Scene


class Play(NamedTuple):
    """A run ready to be played: the machine as it is, its sensors, and the scenes as they come, by scene."""

    loaded: Loaded
    seed: int
    truth: Truth
    made: Sensors
    header: dict[str, JsonValue]
    records: Iterator[Record]

    @property
    def service(self) -> Service:
        """The machine file's settings."""
        return self.loaded.service


class _EffectTable(BaseModel):
    """An effect of the diagnosis' library, switched on in the simulated machine; SI units."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    at: str
    value: float | tuple[float, ...]
    shape: dict[str, float] = {}
    from_s: float = 0.0
    until_s: float = inf


class _EffectsFile(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")

    effects: tuple[_EffectTable, ...]


def prepare(
    loaded: Loaded,
    scenario: str,
    seed: int,
    mass_error: float,
    *,
    amount: float,
    effects: Path | None = None,
    library: tuple[Group, ...] = LIBRARY,
    payload: float = 0.0,
    turning: bool = False,
    motion: Path | None = None,
) -> Play:
    """Return a run of `amount` cycles or seconds; machine, motion and noise each have a generator of their own.

    effects: a file of effects of the `library`
    motion:  a table of joint angles that is played in place of the scenario
    """
    machine = loaded.service.machine
    extra = read_effects(effects, loaded, library) if effects else ()
    truth = draw_truth(machine, np.random.default_rng((seed, 0)), mass_error, extra)
    header: dict[str, JsonValue] = {"seed": seed, "scenario": scenario, "mass_error": mass_error}
    header |= {"machine_sha256": loaded.sha256, **describe_truth(machine, truth)}
    made = sensors(machine, loaded.service.nodes)
    rng = np.random.default_rng((seed, 1))
    if motion is not None:
        header["scenario"] = motion.name
        scenes: Iterable[Scene] = [read_scene(motion, machine, payload)]
    elif scenario == "moves":
        scenes = [moves(machine, rng, amount, payload=payload, turning=turning)]
    else:
        scenes = _digging(loaded.service, rng, round(amount))
    noise = np.random.default_rng((seed, 2))
    records = run(machine, truth, made, scenes, dt=1.0 / loaded.service.filters.rate_hz, rng=noise)
    return Play(loaded, seed, truth, made, header, records)


def _digging(service: Service, rng: np.random.Generator, count: int) -> Iterable[Scene]:
    swing = any(s.kind in (Kind.SLEW_RATE, Kind.SLEW_ANGLE) for s in service.machine.signals)
    return digging_cycles(service.machine, rng, count, swing)


def read_effects(path: Path, loaded: Loaded, library: tuple[Group, ...] = LIBRARY) -> tuple[Imposed, ...]:
    """The effects of a file, by their names in the `library`. Raises SettingsError."""
    text = _effects_text(path)
    try:
        raw = tomllib.loads(text)
    except ValueError as error:
        raise SettingsError(f"{path}: is not TOML: {error}; correct it") from error
    source = Source(path, text, raw)
    try:
        tables = _EffectsFile.model_validate(raw).effects
    except ValidationError as error:
        faults = [_fault(found) for found in error.errors()]
        raise SettingsError(error_text(source, faults)) from error
    return tuple(_imposed(loaded, each, source, k, library) for k, each in enumerate(tables))


def _effects_text(path: Path) -> str:
    if is_stream(path):
        raise SettingsError(f"{path}: is no ordinary file but a pipe or a device: give a file with [[effects]]")
    if is_large(path):
        raise SettingsError(f"{path}: is larger than {LARGEST // 10**6} MB: give a file with [[effects]]")
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise SettingsError(f"{path}: cannot be read ({error.strerror}): give a file with [[effects]]") from error
    except UnicodeDecodeError as error:
        raise SettingsError(f"{path}: is no text (byte {error.start}): give a file with [[effects]]") from error


def _fault(found: ErrorDetails) -> FaultError:
    key = found["loc"]
    return fault(found, key, _EffectsFile if len(key) == 1 else _EffectTable)


def _imposed(loaded: Loaded, table: _EffectTable, source: Source, k: int, library: tuple[Group, ...]) -> Imposed:
    """One effect of a file. Raises SettingsError with file and line."""
    machine = loaded.service.machine
    try:
        return imposed(
            *(machine, table.name, table.at, table.value),
            shape=table.shape,
            begin=table.from_s,
            end=table.until_s,
            library=library,
        )
    except ValueError as error:
        line = line_of(source.text, ("effects", k))
        raise SettingsError(f"{source.path}:{line}: {error}") from error
