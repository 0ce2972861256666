"""What a diagnosis knows of the healthy machine: the references of a case, one of them, an identification, nothing."""

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import Any, Self

from cylforce.files.atomic import RecordingError
from cylforce.programs.common.machine_statistics import statistics_path
from cylforce.programs.identify import How, run_identify, run_statistics
from cylforce.settings.machine_file import Loaded, load

Record = dict[str, Any]
IDENTIFIED = "identified.toml"
MOVED_EMPTY = ("strokes", "stairs", "sines", "empty")  # words of references from which tares can be identified


class Knowledge(StrEnum):
    """How much of the healthy machine the diagnosis is given."""

    REFERENCES = "references"
    ONE_REFERENCE = "one-reference"
    STATISTICS = "statistics"
    IDENTIFIED = "identified"
    DATA_SHEET = "data-sheet"


@dataclass
class Limited:
    """Takes from the folders of one machine's cases what the diagnosis shall not know. A context manager.

    Tares, and statistics beside them, are identified once from the empty references of a case.

    knowledge: how much the diagnosis is given
    identify:  writes the tares of some recordings
    """

    knowledge: Knowledge
    identify: Callable[[Loaded, list[Path], Path, How], object] = run_identify
    _kept: dict[tuple[str, ...], Path | None] = field(default_factory=dict)
    _folder: TemporaryDirectory[str] | None = None

    def __enter__(self) -> Self:
        self._folder = TemporaryDirectory(prefix="identified")
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if self._folder is not None:
            self._folder.cleanup()

    def apply(self, folder: Path) -> list[str]:
        """Change case.json of a folder, and add identified.toml where the knowledge is an identification.

        Returns the names of what the field can be compared with; of a data sheet alone, none.
        """
        path = folder / "case.json"
        case: Record = json.loads(path.read_text())
        if self.knowledge is Knowledge.REFERENCES:
            return list(case["reference"])
        names = case["reference"][:1] if self.knowledge is Knowledge.ONE_REFERENCE else []
        if self.knowledge in (Knowledge.STATISTICS, Knowledge.IDENTIFIED):
            case |= self._identified(folder, case)
        else:
            case.pop("identified", None)
        shown = {*case["field"], *names}
        loads = {name: kilograms for name, kilograms in case["loads_kg"].items() if name in shown}
        for name in set(case["reference"]) - shown:
            (folder / name).unlink()
        path.write_text(json.dumps(case | {"reference": names, "loads_kg": loads}, indent=1) + "\n")
        return [*names, *([case["identified"]] if "identified" in case else [])]

    def _identified(self, folder: Path, case: Record) -> Record:
        """Put identified.toml into a folder and return its entry in case.json; nothing where references do not suffice.

        What a labelled folder brings along counts, else tares are identified from the references without a load.
        """
        own = [name for name in case["reference"] if name not in case["loads_kg"]]
        if "identified" not in case:
            own = [name for name in own if any(word in name for word in MOVED_EMPTY)]
        key = ((folder / "machine.toml").read_text(), *own)
        if key not in self._kept:
            self._kept[key] = self._learnt(folder, own, case.get("identified"))
        tares = self._kept[key]
        if tares is None:
            return {}
        (folder / IDENTIFIED).unlink(missing_ok=True)
        shutil.copy(tares, folder / IDENTIFIED)
        if self.knowledge is Knowledge.STATISTICS:
            shutil.copy(statistics_path(tares), statistics_path(folder / IDENTIFIED))
        return {"identified": IDENTIFIED}

    def _learnt(self, folder: Path, names: list[str], given: str | None) -> Path | None:
        """Return the path of tares, with statistics beside them where they are wanted; None where it is refused."""
        if self._folder is None:
            raise ValueError("Limited is a context manager: enter it")
        into = Path(self._folder.name) / f"machine_{len(self._kept)}"
        into.mkdir()
        tares, loaded = into / IDENTIFIED, load(folder / "machine.toml")
        paths = [(folder / name).resolve() for name in names]
        try:
            if given:
                shutil.copy(folder / given, tares)
            else:
                self.identify(loaded, paths, tares, How(refuse=False))
            if self.knowledge is Knowledge.STATISTICS:
                run_statistics(loaded, paths, tares)
        except (RecordingError, ValueError):
            return None
        return tares
