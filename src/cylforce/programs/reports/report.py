"""The reports, each one file of HTML: of `cylforce identify`, how well the machine is known; of `cylforce gap`,
why it differs from its model."""

import tomllib
from collections.abc import Iterable
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cylforce
from cylforce.commissioning.identification import Identification
from cylforce.files.atomic import RecordingError, replacing
from cylforce.files.logfile import file_sha256
from cylforce.programs.common.gap_question import Question
from cylforce.programs.common.progress import Watch, silent
from cylforce.programs.gap import Diagnosed
from cylforce.programs.wording.plain import looked, plain
from cylforce.settings.machine_file import Loaded
from cylforce.signals.estimate import Array

NEEDED = ("matplotlib", "jinja2")


def check_extra() -> None:
    """Before anything is computed: is what the report needs installed? Raises RecordingError."""
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        raise RecordingError(f"a report needs {' and '.join(missing)}: pip install 'cylforce[report]'")


def write_report(
    path: Path,
    found: Identification,
    segments: Iterable[tuple[str, Array]],
    identified: Path,
    watch: Watch = silent,
) -> None:
    """Write the report of `found`, which stands in the file `identified`, whole or not at all; `segments` are the
    recordings once more: (name, gapless samples (T, S)). Raises RecordingError."""
    from cylforce.programs.reports.evidence import evidence
    from cylforce.programs.reports.findings import findings
    from cylforce.programs.reports.page import page

    shown = evidence(found.model, found.tares, segments)
    watch("drawing the report", None)
    origin = tomllib.loads(identified.read_text(encoding="utf-8"))["provenance"]
    origin |= {"output": identified.name, "output_sha256": file_sha256(identified)}
    text = page(found, shown, findings(found, shown), origin)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def gap_report(loaded: Loaded, question: Question, found: Diagnosed, watch: Watch = silent) -> str:
    """The report of a diagnosis, as HTML."""
    from cylforce.programs.reports.gap_page import gap_page

    watch("drawing the report", None)
    said = plain(loaded.service.machine, found.answer)
    return gap_page(
        found.diagnosis, {"next_experiment": ()} | found.answer, said, _origin(loaded, question, found.answer)
    )


def _origin(loaded: Loaded, question: Question, answer: dict[str, Any]) -> dict[str, Any]:
    identified = () if question.identified is None else (question.identified,)
    groups = {
        "field": question.field,
        "reference": question.reference,
        "simulation": question.simulation,
        "identified": identified,
    }
    shares = iter(looked(part) for part in answer.get("looked_at", ()))  # in the order of the recordings
    return {
        "machine": loaded.service.machine.name,
        "machine_sha256": loaded.sha256,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "version": cylforce.__version__,
    } | {kind: [_file(path, question.loads, next(shares, "")) for path in paths] for kind, paths in groups.items()}


def _file(path: Path, loads: dict[str, float], share: str) -> dict[str, Any]:
    return {"name": path.name, "sha256": file_sha256(path), "load": loads.get(path.name, 0.0), "looked_at": share}
