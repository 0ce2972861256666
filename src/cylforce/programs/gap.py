"""`cylforce gap`: why a machine differs from its model."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tomlkit
from rich.console import Console
from rich.table import Table as Text

from cylforce.core.assembler import Assembler
from cylforce.core.gap.answer import answer
from cylforce.core.gap.diagnosis import Search, fitted_tares, search
from cylforce.core.gap.library import LIBRARY, Group
from cylforce.core.gap.residuals import Gap, courses, ends, gap
from cylforce.core.gap.rows import RATE_HZ, Recorded, Viewer
from cylforce.core.gap.verdict import Judged, Verdict, judged
from cylforce.core.gap.where import where
from cylforce.core.model import FRICTION, Model, Tares
from cylforce.core.segments import samples, stretches
from cylforce.edges.files import RecordingError, replacing
from cylforce.edges.identified import read_identified
from cylforce.edges.recording import open_recording
from cylforce.edges.settings import Loaded
from cylforce.edges.tables import Table
from cylforce.programs.identify import ordered
from cylforce.programs.progress import Watch, silent, watched
from cylforce.words.estimate import Array
from cylforce.words.events import Frame, Tick

SHORTEST_S = 20.0  # of a stretch
MOVING_S = 20.0  # of usable rows of any joint, below which nothing is concluded
BELIEVED = 0.01  # of the data sheet's tolerances, where it is all that is known: its errors then count as effects
SEED = 1  # of the permutations and of the bootstrap


class Question(NamedTuple):
    """What is asked: faulty recordings, clean ones, known loads [kg] by file name, tares, `only` NAME@AT."""

    field: tuple[Path, ...]
    reference: tuple[Path, ...] = ()
    identified: Path | None = None
    loads: dict[str, float] = {}  # noqa: RUF012
    only: str | None = None


class Diagnosed(NamedTuple):
    """The search, the verdict, the gap's size, and the whole answer as plain values."""

    search: Search | None
    judged: Judged
    gap: Gap | None
    answer: dict[str, Any]


def diagnose(
    loaded: Loaded, question: Question, library: tuple[Group, ...] = LIBRARY, watch: Watch = silent
) -> Diagnosed:
    """The diagnosis of recordings. Raises RecordingError or ValueError, in a sentence."""
    _check_loads(question)
    clean = [r for path in question.reference for r in recorded(loaded, path, question.loads, watch)]
    faulty = [r for path in question.field for r in recorded(loaded, path, question.loads, watch)]
    if not faulty:
        return _nothing(f"no gapless stretch of {SHORTEST_S:.0f} s in {', '.join(p.name for p in question.field)}")
    viewer, known = _viewer(loaded, question, clean)
    found = search(viewer, faulty, clean, _only(library, question.only), lambda doing: watch(doing, None), known)
    seconds = float(np.sum(found.blocks.faulty_rows)) / RATE_HZ
    if seconds < MOVING_S:
        return _nothing(f"only {seconds:.0f} s of usable motion: move every joint both ways, slowly and fast")
    verdict, rng = judged(found), np.random.default_rng(SEED)
    watch("where it lies, how far it shrinks", None)
    size = gap(found, rng)
    return Diagnosed(found, verdict, size, answer(found, verdict, size, ends(found), where(found, rng)))


def _nothing(reason: str) -> Diagnosed:
    verdict = Judged(Verdict.NOT_OBSERVABLE, (), 0.0)
    return Diagnosed(None, verdict, None, {"verdict": str(verdict.verdict), "effects": [], "reason": reason})


def _check_loads(question: Question) -> None:
    names = {path.name for path in (*question.field, *question.reference)}
    for name, kilograms in question.loads.items():
        if name not in names:
            raise RecordingError(f"--load {name}: is none of the recordings ({', '.join(sorted(names))})")
        if not 0.0 <= kilograms < 1e6:
            raise RecordingError(f"--load {name}={kilograms:g}: is no weight in kg")


def _only(library: tuple[Group, ...], only: str | None) -> tuple[Group, ...]:
    """The library, or what it has of one name."""
    if only is None:
        return library
    name = only.partition("@")[0]
    found = tuple(group for group in library if group[0].about.name == name)
    if not found:
        known = ", ".join(dict.fromkeys(group[0].about.name for group in library))
        raise ValueError(f"effect {name!r} is not known: choose one of {known}")
    return found


def _viewer(loaded: Loaded, question: Question, clean: Sequence[Recorded]) -> tuple[Viewer, Array | None]:
    """Model and tares: identified ones, else those of the clean recordings, else the data sheet, without friction."""
    service = loaded.service
    if question.identified is None and not clean:
        sheet = Model(service.machine, service.filters, ())
        return Viewer(sheet, sheet.prior.mean), BELIEVED * np.sqrt(np.diag(sheet.prior.covariance))
    model = Model(service.machine, service.filters, FRICTION)
    if question.identified is None:
        return Viewer(model, fitted_tares(model, clean)), None
    values, error = _spread_out(model, read_identified(question.identified, loaded))
    return Viewer(model, values), None if clean else error


def _spread_out(model: Model, tares: Tares) -> tuple[Array, Array]:
    """Tares and their standard errors (P,) for a model with all friction laws; absent laws are 0, known as before."""
    error = np.sqrt(np.diag(tares.covariance))
    known = {name: (v, e) for name, v, e in zip(tares.names, tares.values, error, strict=True)}
    before = np.sqrt(np.diag(model.prior.covariance))
    pairs = [known.get(p.name, (0.0, b)) for p, b in zip(model.parameters, before, strict=True)]
    return np.array([v for v, _ in pairs]), np.array([e for _, e in pairs])


def recorded(loaded: Loaded, path: Path, loads: dict[str, float], watch: Watch = silent) -> Iterator[Recorded]:
    """The gapless stretches of a recording that are long enough to be diagnosed."""
    service, load = loaded.service, loads.get(path.name, 0.0)
    rate = service.filters.rate_hz
    longest = int(service.health.hold_s * rate)
    for begins, values in _pieces(loaded, path, watch):
        for first, stretch in stretches(values, longest):
            if len(stretch) >= SHORTEST_S * rate:
                yield Recorded(path.name, stretch, load, begins + first / rate)


def _pieces(loaded: Loaded, path: Path, watch: Watch) -> Iterator[tuple[float, Array]]:
    """Samples (T, S) of a recording with the time [s] of their first row."""
    service = loaded.service
    recording = open_recording(path, service, loaded.columns)
    if isinstance(recording, Table):
        yield float(recording.t_s[0]), ordered(recording, loaded, path)
        return
    events = watched(path, (e for e in recording.events if isinstance(e, Frame | Tick)), watch)
    rows = 0
    for piece in samples(Assembler(service), events, round(1e6 / service.filters.rate_hz)):
        yield rows / service.filters.rate_hz, piece
        rows += len(piece)


def write_answer(path: Path, found: Diagnosed) -> None:
    """The answer as JSON."""
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(found.answer, indent=1, default=float) + "\n")


def write_residuals(path: Path, found: Diagnosed) -> None:
    """What is left of every recording before and after (NAME.t, NAME.before, NAME.after; NumPy's npz)."""
    columns: dict[str, Array] = {}
    for course in courses(found.search) if found.search else ():
        name = Path(course.name).stem
        columns |= {f"{name}.t": course.t, f"{name}.before": course.before, f"{name}.after": course.after}
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **columns)


def write_patch(path: Path, found: Diagnosed) -> None:
    """What was found as blocks that `cylforce sim --effects` takes."""
    document = tomlkit.document()
    blocks = tomlkit.aot()
    for effect in found.answer["effects"]:
        block = tomlkit.table()
        block.add("name", effect["name"])
        block.add("at", effect["at"])
        block.add("value", float(effect["parameters"]["size"]["value"]))
        for key, value in effect["shape"].items():
            block.add(key, value)
        blocks.append(block)
    document.add("effects", blocks)
    with replacing(path) as temporary:
        temporary.write_text(tomlkit.dumps(document))


def show(found: Diagnosed, console: Console) -> None:
    """The verdict in a sentence, the effects in a table."""
    console.print(sentence(found.answer))
    if found.gap is None:
        return
    text = Text()
    for column in ("effect", "at", "size", "90 % interval", "unit", "confidence", "or"):
        text.add_column(column, justify="right" if column in ("size", "90 % interval", "confidence") else "left")
    for effect in found.answer["effects"]:
        size = effect["parameters"]["size"]
        others = ", ".join(f"{o['name']} at {o['at']}" for o in effect["confused_with"])
        interval = f"{size['low']:.3g} .. {size['high']:.3g}"
        row = (effect["name"], effect["at"], f"{size['value']:.4g}", interval, size["unit"])
        text.add_row(*row, f"{100 * effect['confidence']:.0f} %", others)
    if found.answer["effects"]:
        console.print(text)
    for experiment in found.answer["next_experiment"]:
        console.print(f"next: {experiment}")


def sentence(answer: dict[str, Any]) -> str:
    """The verdict in words."""
    verdict, size = answer["verdict"], answer.get("gap")
    if size is None:
        return f"Nothing can be concluded: {answer['reason']}."
    gap_nm = f"{size['fixed']:.0f} N m (noise floor {size['floor']:.0f} N m)"
    if verdict == Verdict.NO_GAP:
        return f"No gap: what the model leaves, {gap_nm}, is what it always left."
    if verdict == Verdict.UNKNOWN:
        return f"There is a gap, {gap_nm}, and none of the known effects explains it."
    names = " and ".join(f"{e['name']} at {e['at']}" for e in answer["effects"])
    closure = answer["effects"][0]["closure"]
    words = {Verdict.AMBIGUOUS: "may be caused by", Verdict.PARTLY: "is caused in part by"}
    verb = words.get(verdict, "is caused by")
    return f"The gap, {gap_nm}, {verb} {names}; with it {100 * closure['value']:.0f} % of the gap's energy is gone."
