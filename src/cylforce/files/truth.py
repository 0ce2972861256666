"""The truth file of a simulated run. It is for comparison with the results; the service never reads it.

One line `# {...}` of JSON (seed, scenario, the true machine), then CSV, SI units, one row per sample.
"""

import csv
import json
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Self

import numpy as np
from pydantic import JsonValue

from cylforce.effects.loads.slew import slew_parameters
from cylforce.files.atomic import RecordingError, check_ordinary
from cylforce.mechanics.machine import Machine, base_parameters
from cylforce.signals.estimate import Array
from cylforce.simulation.sensing import Record
from cylforce.simulation.simulator import Truth

TIME = "t_us"  # name of the time column


class TruthTable(NamedTuple):
    """A truth file.

    header: its JSON
    t_us: (T,) times [us]
    columns: (T,) by name, see `truth_columns`
    """

    header: dict[str, JsonValue]
    t_us: "np.ndarray[tuple[int, ...], np.dtype[np.int64]]"
    columns: dict[str, Array]


def describe_truth(machine: Machine, truth: Truth) -> dict[str, JsonValue]:
    """Return the truth about a simulated machine, for the header of its truth file [SI].

    parameters: of each link J [kg m^2], X, Z [kg m], D_excess, E [kg m^2], as LINK.SYMBOL; the friction of each
        cylinder, as CYLINDER.NAME
    masses: of each link, by its name [kg]
    pitch, roll: of the ground [rad]
    effects: further effects: name, location, sizes [SI]
    """
    base, slew = base_parameters(truth.links).reshape(-1, 3), slew_parameters(truth.links)
    parameters: dict[str, JsonValue] = {}
    for link, row in zip(truth.links, np.concatenate([base, slew], axis=1).tolist(), strict=True):
        symbols = ("J", "X", "Z", "D_excess", "E")
        parameters |= {f"{link.name}.{s}": value for s, value in zip(symbols, row, strict=True)}
    for cause in truth.friction:
        parameters |= {
            f"{c.name}.{cause.name}": v for c, v in zip(machine.cylinders, cause.value.tolist(), strict=True)
        }
    masses: dict[str, JsonValue] = {link.name: link.mass for link in truth.links}
    effects: list[JsonValue] = [
        {"name": e.group[0].about.name, "at": e.at, "value": list(e.sizes)} for e in truth.effects
    ]
    return {
        "parameters": parameters,
        "masses": masses,
        "pitch": truth.pitch,
        "roll": truth.roll,
        "effects": effects,
    }


def truth_columns(machine: Machine, record: Record) -> tuple[tuple[str, ...], Array]:
    """Return names and values (T, K) of the columns of a truth file [SI].

    They are `t_s`, the time from the start of the run, `cycle` (the scene's number), `phase` (see `Phase`), load `mass`
    and `centre_x`, `centre_z` in the last link's frame, the soil's force and the teeth's place (x forward, z up, true
    vertical; place from the first pin), `pitch`, `roll`, `slew`, joint angles, cylinder forces and the friction within
    them.
    """
    p = record.physics
    house = [np.broadcast_to(x, p.t.shape) for x in (p.attitude.pitch, p.attitude.roll, p.course.slew)]
    single = [record.t, np.full_like(p.t, record.scene), p.course.phase, p.load.mass, *p.load.centre.T]
    names = ["t_s", "cycle", "phase", "mass", "centre_x", "centre_z", "soil_x", "soil_z", "tip_x", "tip_z"]
    names += ["pitch", "roll", "slew", *(f"theta.{link.name}" for link in machine.links)]
    names += [f"{what}.{c.name}" for what in ("force", "friction") for c in machine.cylinders]
    wide = [p.course.theta, p.moving.force, p.friction]
    return tuple(names), np.column_stack([*single, p.soil, p.tip, *house, *wide])


class TruthWriter:
    """Writes a truth file row by row; it can be read while the run continues.

    path: the file
    header: its JSON
    names: (K,) names of the columns behind the time
    """

    def __init__(self, path: Path, header: dict[str, JsonValue], names: Iterable[str]) -> None:
        """Open the file and write its header. Raises RecordingError when the disk refuses."""
        self._path = path
        try:
            self._file = path.open("w", encoding="utf-8", newline="", buffering=1)
        except OSError as error:
            raise RecordingError(f"{path}: cannot be written: {error.strerror or error}") from error
        self._file.write(f"# {json.dumps(header)}\n{','.join((TIME, *names))}\n")

    def write(self, t_us: Iterable[int], rows: Array) -> None:
        """Write rows (T, K) [SI] at the times (T,) [us], with nine significant digits."""
        lines = (f"{t},{','.join(f'{x:.9g}' for x in row)}\n" for t, row in zip(t_us, rows.tolist(), strict=True))
        self._file.writelines(lines)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()


def read_truth(path: Path) -> TruthTable:
    """Read a truth file. Raises RecordingError when it is not one."""
    check_ordinary(path)
    try:
        with path.open(encoding="utf-8", newline="") as file:
            header = json.loads(file.readline().removeprefix("# "))
            rows = csv.reader(file)
            names = next(rows)
            table = np.array([[float(cell) for cell in row] for row in rows]).reshape(-1, len(names))
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (ValueError, StopIteration) as error:
        raise RecordingError(f"{path}: is no truth file of `cylforce sim`: {error}") from error
    columns = {name: table[:, k] for k, name in enumerate(names)}
    return TruthTable(header, columns.pop(TIME).astype(np.int64), columns)
