"""A folder of labelled machines, whoever made them, as cases of the trial.

FOLDER holds `labels.json` and one folder per machine with `machine.toml`, references, and the recordings that the
labels list. A recording whose name begins with `reference` is one. Every other recording is asked with all references
of its machine, and with tares identified from them; the diagnosis sees a folder in which no name tells anything."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from cylforce.files.atomic import RecordingError
from cylforce.programs.identify import How, run_identify
from cylforce.settings.machine_file import load

from .diagnosis import Diagnosis
from .judged import VISIBLE
from .knowledge import Limited

Record = dict[str, Any]
REFERENCE = "reference"
ANOTHER_NAME = {  # what labels call it, and the library
    "soil_contact_in_air": "soil_contact",
}
AT_THE_TEETH = {"bucket tip": "bucket", "payload": "bucket"}
ASKED_AGAIN = "asked_again"  # in an order: whether also without the effect


@dataclass(frozen=True)
class Labelled:
    """A recording of a machine and its label; `folder` is the machine's."""

    folder: Path
    label: Record

    @property
    def key(self) -> tuple[str, str]:
        """Machine and recording."""
        return self.folder.name, str(self.label["recording"])

    @cached_property
    def effects(self) -> list[Record]:
        """As in a case's label; all places where an effect sits are right."""
        return [_effect(each) for each in self.label["effects"]]

    @property
    def truth(self) -> tuple[str, str]:
        """Name and place of the one effect, in the library's words; empty for a machine in order."""
        return (self.effects[0]["name"], self.effects[0]["at"]) if self.effects else ("", "")

    @property
    def nameable(self) -> bool:
        """Whether the library has the effect."""
        return all(effect["nameable"] for effect in self.label["effects"])

    @property
    def over_floor(self) -> float:
        """What the effect leaves over the floor, at the joint where that is most; 1 in order."""
        return max((e["over_floor"] for e in self.effects), default=1.0)

    @property
    def kind(self) -> str:
        """As of a case."""
        if not self.effects:
            return "none"
        return "foreign" if not self.nameable else "pair" if len(self.effects) > 1 else "known"


def _effect(given: Record) -> Record:
    places = [AT_THE_TEETH.get(at, at) for at in given["at"]]
    size = {"size": given.get("strength"), "unit": given.get("unit", "")}
    name, most = given["name"], max(float(x) for x in given["residual_over_floor"])
    return {"name": ANOTHER_NAME.get(name, name), "at": places[0], "places": places, "over_floor": most} | size


def labelled(folder: Path) -> list[Labelled]:
    """All recordings but references. Raises OSError, ValueError or KeyError where labels.json lacks something."""
    labels = json.loads((folder / "labels.json").read_text())
    return [Labelled(folder / each["machine"], each) for each in labels if not each["recording"].startswith(REFERENCE)]


def references(folder: Path) -> tuple[Path, ...]:
    """The recordings of a machine while it was in order."""
    return tuple(sorted(p for p in folder.glob(f"{REFERENCE}*.parquet") if not p.stem.endswith("_truth")))


def orders(found: Sequence[Labelled]) -> list[Record]:
    """What is asked: of every known effect the first visible recording also without it."""
    asked, seen = [], set[str]()
    for each in found:
        again = each.kind == "known" and each.over_floor >= VISIBLE and each.truth[0] not in seen
        seen |= {each.truth[0]} if again else set()
        asked.append({"case": "/".join(each.key), "machine": each.key[0], ASKED_AGAIN: again})
    return asked


def label(each: Labelled) -> Record:
    """The label as scorers read it."""
    told = {"case": "/".join(each.key), "kind": each.kind, "poor": "", "clutter": [], "effects": each.effects}
    return told | {"machine": each.key[0], "scenario": each.label["scenario"], "rough": each.label.get("rough", False)}


def case_folder(each: Labelled, folder: Path, tares: Path | None) -> None:
    """Links to machine file, tares and recordings, none of which is called by its own name."""
    given = {f"reference_{k}": path for k, path in enumerate(references(each.folder))}
    for name, path in {"field": each.folder / f"{each.key[1]}.parquet", **given}.items():
        (folder / f"{name}.parquet").symlink_to(path.resolve())
    (folder / "machine.toml").symlink_to((each.folder / "machine.toml").resolve())
    found: Record = {"field": ["field.parquet"], "reference": [f"{name}.parquet" for name in given], "loads_kg": {}}
    if tares is not None:
        (folder / "identified.toml").symlink_to(tares.resolve())
        found["identified"] = "identified.toml"
    (folder / "case.json").write_text(json.dumps(found) + "\n")


@lru_cache(maxsize=1)
def tares_of(folder: Path, into: Path) -> Path | None:
    """Tares identified from a machine's references; none where these are not enough."""
    out = into / f"{folder.name}.toml"
    try:
        run_identify(load(folder / "machine.toml"), references(folder), out, How(refuse=False))
    except (RecordingError, ValueError):
        return None
    return out


def source_records(
    diagnosis: Diagnosis, asked: Sequence[tuple[Labelled, Record]], limited: Limited
) -> Iterator[Record]:
    """Cases of one machine, one after the other."""
    with TemporaryDirectory() as tares:
        for each, order in asked:
            found = tares_of(each.folder, Path(tares))
            with TemporaryDirectory(prefix="case") as name:
                case_folder(each, Path(name), found)
                compared = limited.apply(Path(name))
                record = _record(diagnosis, each, order, Path(name))
                yield record | {"label": record["label"] | {"references": compared}}


def _record(diagnosis: Diagnosis, each: Labelled, order: Record, folder: Path) -> Record:
    answer, again = diagnosis.answer(folder), None
    if order[ASKED_AGAIN]:
        again = diagnosis.left_out(folder, (each.truth[0],))
    return {
        "case": order["case"],
        "order": order,
        "label": label(each),
        "after": {"closure": None},
        "answer": answer,
        "without": again,
        "simulated_s": 0.0,
    }
