"""One machine's cases: simulated, sealed, diagnosed, opened, put into the table."""

import fcntl
import json
import secrets
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cylforce.settings.machine_file import load

from .cases import Case, sealed, simulated, write
from .diagnosis import Diagnosis
from .field import Site
from .knowledge import Knowledge, Limited
from .orders import Order
from .repertoire import LOAD_KG
from .scoring import true_closure
from .sigmas import DETECTED, Comparison, Floor, Rows, compared

Array = NDArray[np.float64]
Record = dict[str, Any]


@dataclass(frozen=True)
class Trial:
    """How cases are run.

    table:     file that the cases are appended to
    share:     of the usual durations
    diagnosis: the command
    oracle:    whether a diagnosis that is given the effect's name is run, too
    knowledge: what the diagnosis knows of the healthy machine
    """

    table: Path
    share: float = 1.0
    diagnosis: Diagnosis = field(default_factory=Diagnosis)
    oracle: bool = True
    knowledge: Knowledge = Knowledge.REFERENCES

    def done(self) -> list[Record]:
        """The records of the table so far."""
        if not self.table.exists():
            return []
        found: list[Record] = [json.loads(line) for line in self.table.read_text().splitlines()]
        if any("over_floor" not in effect for record in found for effect in record["label"]["effects"]):
            raise ValueError(
                f"{self.table}: its effects lack over_floor, as in tables of older trials: give another --table"
            )
        return found

    def append(self, record: Record) -> None:
        """One line more; several processes may write."""
        with self.table.open("a", encoding="utf-8") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            file.write(json.dumps(record) + "\n")


def run_machine(trial: Trial, orders: Sequence[Order]) -> int:
    """All cases of one machine; returns how many."""
    site = Site(orders[0].machine, orders[0].friction, trial.share)
    with Limited(trial.knowledge) as limited:
        for record in records(trial, site, orders, limited):
            trial.append(record)
    return len(orders)


def records(trial: Trial, site: Site, orders: Sequence[Order], limited: Limited | None = None) -> Iterator[Record]:
    """The cases one after the other. The label is sealed before the diagnosis starts, and opened after its answer;
    meanwhile it is nowhere but in the memory of this process."""
    for wanted in orders:
        start = time.process_time()
        case, twin = simulated(site, wanted)
        with TemporaryDirectory(prefix="case") as name:
            folder = Path(name)
            write(case, folder)
            truth = Truth(case, twin, folder)
            label = json.loads(json.dumps(truth.sized(site)))
            if limited is not None:
                label["references"] = limited.apply(folder)
            salt = secrets.token_hex(16)
            digest = sealed(label, salt)
            print(f"case {wanted.number} sealed {digest}", flush=True)
            took = time.process_time() - start
            answer = trial.diagnosis.answer(folder)
            opened = truth.opened(label, folder, trial if trial.oracle else None) | truth.beside(label, answer, site)
            again = trial.diagnosis.left_out(folder, wanted.names) if wanted.without else None
        if sealed(label, salt) != digest:
            raise RuntimeError(f"case {wanted.number}: the label is not the one that was sealed")
        yield {
            "case": wanted.number,
            "order": asdict(wanted),
            "sealed": digest,
            "salt": salt,
            "label": label,
            "after": opened,
            "answer": answer,
            "without": again,
            "simulated_s": took,
        }


def _detectable(effect: Record, sigmas: float) -> float | None:
    """The size at five sigma: a stiffness is the larger the smaller its effect."""
    if not sigmas:
        return None
    share = DETECTED / sigmas
    return float(effect["size"] / share if effect["name"] == "compliance" else effect["size"] * share)


class Truth:
    """What is computed from the twin: the size of a case's effects and, after the answer, the share of the gap that it
    really removed."""

    def __init__(self, case: Case, twin: dict[str, Array], folder: Path) -> None:
        self.case = case
        self.floor = Floor(load(folder / "machine.toml"), LOAD_KG)
        self.references = self._rows(case.references)
        self.twin = self._rows(twin)
        self.whole = self._compared(case)

    def _rows(self, recordings: dict[str, Array]) -> list[Rows]:
        quiet = self.case.quiet
        return [self.floor.rows(name, values, quiet[name]) for name, values in recordings.items()]

    def _compared(self, case: Case) -> Comparison:
        return compared(self.floor, self.references, self.twin, self._rows(case.field))

    def sized(self, site: Site) -> Record:
        """The label with each effect's size: residual with it in floors of the clean machine, and standard errors."""
        label = dict(self.case.label)
        effects = [dict(e) for e in label["effects"]]
        if len(effects) == 1 and not label["clutter"]:
            parts = [self.whole]
        else:
            parts = [self._alone(site, k) for k in range(len(effects))]
        for entry, part in zip(effects, parts, strict=True):
            entry["over_floor"], entry["sigmas"] = part.over_floor, part.effect.sigmas
            entry["detectable"] = _detectable(entry, part.effect.sigmas)
        return label | {"effects": effects, "sigmas": self.whole.effect.sigmas}

    def _alone(self, site: Site, k: int) -> Comparison:
        """One of several effects without the others."""
        return self._compared(simulated(site, self.case.order, only=k)[0])

    def opened(self, label: Record, folder: Path, trial: Trial | None) -> Record:
        """What the truth adds to an answer: the share that it really removed, the payload error of the fit that
        knows."""
        found: Record = {"closure": self._closure(folder / "residuals.npz")}
        effects = label["effects"]
        if trial and len(effects) == 1 and "--only" in trial.diagnosis.options and label["kind"] == "known":
            answer = trial.diagnosis.answer(folder, ("--only", f"{effects[0]['name']}@{effects[0]['at']}"))
            payload = (answer.get("end_quantities") or {}).get("payload_kg") or {}
            found["oracle_payload_kg"] = payload.get("after")
        return found

    def beside(self, label: Record, answer: Record, site: Site) -> Record:
        """An effect of the clutter that the answer names first: `present`, its name and place, and the residual with it
        alone in floors of the clean machine. What is large enough to be seen is there, however it is
        called."""
        named = {(e["name"], e["at"]) for e in (answer.get("effects") or [])[:1]}
        for k, small in enumerate(label["clutter"], len(label["effects"])):
            if (small["name"], small["at"]) in named:
                return {"present": dict(small) | {"over_floor": self._alone(site, k).over_floor}}
        return {}

    def _closure(self, path: Path) -> float | None:
        """See `scoring.true_closure`. The answer's rows are NAME.t (T,) [s] from the recording's begin, NAME.before and
        NAME.after (T, R) [N m]: what its nominal model leaves, and what it leaves with the named effects."""
        if not path.exists():
            return None
        stated, first, parts = np.load(path), 0, []
        if any(f"{name}.t" not in stated for name in self.case.field):  # nothing was looked at
            return None
        for name, rows in zip(self.case.field, self.twin, strict=True):
            count = len(rows.torque)
            added = self.whole.difference[first : first + count]
            columns = [np.interp(stated[f"{name}.t"], self.floor.times(count), x) for x in added.T]
            parts.append((np.stack(columns, axis=-1), stated[f"{name}.before"], stated[f"{name}.after"]))
            first += count
        difference, before, after = (np.concatenate(x) for x in zip(*parts, strict=True))
        return true_closure(difference, before, after, self.whole.level)
