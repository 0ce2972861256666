"""A recording and its true values, and their files: tables or a bus log, and the true values in a folder of their
own."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .machinefile import NODES, PDOS, Field, machine_file

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Recording:
    """What the sensors read, `t_s` (T,) and `values` (T, S) of `signals`, SI units; `truth` (T,) by name at the same
    instants, and `header`, what the machine is; see `Machine.run`. `sheet`: its machine file, by default the
    excavator's; `nodes` and `pdos`: how a bus carries the signals."""

    name: str
    t_s: Array
    signals: tuple[str, ...]
    values: Array
    truth: dict[str, Array]
    header: dict[str, object]
    sheet: str = ""
    nodes: Mapping[str, int] = field(default_factory=lambda: NODES)
    pdos: Mapping[str, tuple[Field, ...]] = field(default_factory=lambda: PDOS)

    def column(self, signal: str) -> Array:
        """The values (T,) of a signal."""
        return np.asarray(self.values[:, self.signals.index(signal)])

    def write(self, folder: Path | str, form: str = "parquet") -> Path:
        """FOLDER/machine.toml, FOLDER/NAME.(parquet, csv or log) and, for scoring only, FOLDER/truth/NAME.*; the
        recording's path. Raises ValueError for another form."""
        if form not in ("parquet", "csv", "log"):
            raise ValueError(f"form is {form!r}: choose parquet, csv or log")
        place = Path(folder)
        (place / "truth").mkdir(parents=True, exist_ok=True)
        path = place / f"{self.name}.{form}"
        columns = dict(zip(("t_s", *self.signals), (self.t_s, *self.values.T), strict=True))
        if form == "log":
            path.write_text(self.candump())
        else:
            _write_table(path, columns)
        table = "csv" if form == "csv" else "parquet"
        _write_table(place / "truth" / f"{self.name}.{table}", {"t_s": self.t_s, **self.truth})
        (place / "truth" / f"{self.name}.json").write_text(json.dumps(self.header, indent=1) + "\n")
        (place / "machine.toml").write_text(self.sheet or machine_file(str(self.header["machine_name"])))
        return path

    def candump(self, channel: str = "can0") -> str:
        """The recording as candump writes a bus: SYNC, then every node's TPDO1 0.3 ms after the one before."""
        raw = {}
        for name, scale, offset, size, signed in (one for fields in self.pdos.values() for one in fields):
            count = np.round((self.column(name) - offset) / scale).astype(np.int64)
            low, high = (-(2 ** (8 * size - 1)), 2 ** (8 * size - 1) - 1) if signed else (0, 2 ** (8 * size) - 1)
            raw[name] = [
                int(c).to_bytes(size, "little", signed=signed).hex().upper() for c in np.clip(count, low, high)
            ]
        lines = []
        for k, t in enumerate(self.t_s.tolist()):
            lines.append(f"({t:.6f}) {channel} 080#")
            for n, (node, fields) in enumerate(self.pdos.items()):
                data = "".join(raw[one[0]][k] for one in fields)
                lines.append(f"({t + 0.0003 * (n + 1):.6f}) {channel} {0x180 + self.nodes[node]:03X}#{data}")
        return "\n".join(lines) + "\n"


def _write_table(path: Path, columns: dict[str, Array]) -> None:
    if path.suffix == ".parquet":
        import pyarrow as pa
        import pyarrow.parquet as pq

        pq.write_table(pa.table(columns), path)
        return
    rows = np.column_stack(list(columns.values()))
    with path.open("w", encoding="utf-8") as file:
        file.write(",".join(columns) + "\n")
        file.writelines(",".join(map(repr, row)) + "\n" for row in rows.tolist())
