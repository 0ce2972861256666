"""`cylforce identify --report`: one file of HTML that says how well the machine is known, and what to do about it."""

import tomllib
from collections.abc import Iterable
from importlib.util import find_spec
from pathlib import Path

from cylforce.core.identification import Identification
from cylforce.edges.files import RecordingError, replacing
from cylforce.edges.logfile import file_sha256
from cylforce.programs.progress import Watch, silent
from cylforce.words.estimate import Array

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
    from cylforce.programs.reporting.evidence import evidence
    from cylforce.programs.reporting.findings import findings
    from cylforce.programs.reporting.page import page

    shown = evidence(found.model, found.tares, segments)
    watch("drawing the report", None)
    origin = tomllib.loads(identified.read_text(encoding="utf-8"))["provenance"]
    origin |= {"output": identified.name, "output_sha256": file_sha256(identified)}
    text = page(found, shown, findings(found, shown), origin)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
