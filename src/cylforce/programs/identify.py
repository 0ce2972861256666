"""`cylforce identify`: the dynamic tares from recordings of the empty machine."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.markup import escape

from cylforce.commissioning.common_scale import CommonScale
from cylforce.commissioning.identification import Identification, identify, identify_attachment
from cylforce.effects.library import LIBRARY
from cylforce.estimation.model import Model, Tares
from cylforce.estimation.observation import TooShortError
from cylforce.files.atomic import RecordingError, Report, check_outputs, warn
from cylforce.files.logfile import file_sha256
from cylforce.files.logreader import log_header
from cylforce.mechanics.installation import STANDARD
from cylforce.programs.common.progress import Watch, silent
from cylforce.programs.common.readings import (
    calibrated,
    check_known_kg,
    check_machine,
    model_of,
    named_segments,
    tool_models,
)
from cylforce.programs.common.recorded import SHORTEST_S, at_own_rate, chosen
from cylforce.programs.common.tables import print_table
from cylforce.settings.identified import read_identified, seal_again, write_attachment, write_identified
from cylforce.settings.machine_file import Loaded
from cylforce.signals.estimate import Array


class How(NamedTuple):
    """Options of an identification.

    two_steps:  identify in the paper's two steps
    enforce:    enforce physical laws
    lift:       recording of a lift of a known weight
    known_kg:   the known weight [kg]
    refuse:     end with a sentence for a machine with load, contact or wrong wiring, or an unexplained joint
    attachment: tool on the machine; the output file then provides the common arm, and receives the tool's tares
    usual:      file of the type's usual spread, as prior instead of the data sheet
    """

    two_steps: bool = False
    enforce: bool = False
    lift: Path | None = None
    known_kg: float | None = None
    refuse: bool = True
    attachment: str = STANDARD
    usual: Path | None = None


JOINTLY = How()


def run_identify(
    loaded: Loaded, recordings: Sequence[Path], output: Path, how: How = JOINTLY, watch: Watch = silent
) -> Identification:
    """Identify, write `output`, and return the identification. Raises RecordingError or ValueError with a sentence."""
    _check_recordings(loaded, recordings, how.lift)
    if (how.lift is None) != (how.known_kg is None):
        raise RecordingError("a lift and its known weight go together: give both --lift and --known-kg")
    if how.known_kg is not None:
        check_known_kg(how.known_kg, loaded)
    with _reported() as tell:
        segments = _then_fit(loaded, recordings, watch, tell)
        if how.attachment != STANDARD:
            return _attached(loaded, recordings, segments, output, how)
        found = identify(
            _model(loaded, how),
            segments,
            two_steps=how.two_steps,
            enforce=how.enforce,
            refuse=how.refuse,
        )
    if how.lift is not None and how.known_kg is not None:
        found = calibrated(loaded, found, how.lift, how.known_kg)
    write_identified(output, found, loaded, [(p.name, file_sha256(p)) for p in recordings])
    return found


def run_statistics(
    loaded: Loaded, recordings: Sequence[Path], output: Path, how: How = JOINTLY, watch: Watch = silent
) -> Path:
    """Learn the statistics for `cylforce gap --identified`, write them beside `output`, and return their path.

    The recordings of the identification are read once more; a lift of a known weight counts with its load. Raises
    RecordingError or ValueError.
    """
    # here, because an identification without statistics does without the diagnosis
    from cylforce.programs.common.gap_machine import learnt_machine
    from cylforce.programs.common.machine_statistics import statistics_path, write_statistics

    loaded, _ = at_own_rate(loaded, recordings)
    loads = {how.lift.name: how.known_kg} if how.lift is not None and how.known_kg is not None else {}
    paths = [*recordings, *([how.lift] if how.lift is not None else [])]
    stretches = chosen(loaded, paths, loads, watch, tell=lambda _: None).stretches
    if not stretches:
        raise RecordingError(
            f"no gapless stretch of {SHORTEST_S:.0f} s: {output.name} has no statistics for a diagnosis"
        )
    watch("learning the healthy machine", None)
    tares = read_identified(output, loaded)
    machine = learnt_machine(loaded, stretches, LIBRARY, tares)
    path = statistics_path(output)
    write_statistics(path, machine, loaded, tares)
    return path


@contextmanager
def _reported() -> Iterator[Report]:
    """Yield a function that collects sentences on excluded parts of recordings, and warn of them at the end.

    If no stretch is long enough, they are appended to the sentence of that error. Raises RecordingError.
    """
    told = list[str]()
    try:
        yield told.append
    except TooShortError as error:
        raise RecordingError("; ".join((str(error), *told))) from error
    except BaseException:
        _warn(told)
        raise
    _warn(told)


def _warn(sentences: Sequence[str]) -> None:
    for sentence in sentences:
        warn(sentence)


def _model(loaded: Loaded, how: How) -> Model:
    model = model_of(loaded)
    if how.usual is None:
        return model
    from cylforce.programs.common.usual_file import usual_parameters  # here, as the diagnosis in `run_statistics`

    return replace(model, usual=usual_parameters(how.usual, model.machine))


def _attached(
    loaded: Loaded, recordings: Sequence[Path], segments: Iterator[Array], output: Path, how: How
) -> Identification:
    """Return the tares with another tool, which are added to `output`."""
    if how.lift is not None or how.two_steps or how.enforce or how.usual is not None:
        raise RecordingError("--attachment: takes scale and laws from the standard tool: leave --lift and the like out")
    common = read_identified(output, loaded)
    models = tool_models(loaded, how.attachment, common)
    found = identify_attachment(common, *models, segments, refuse=how.refuse)
    write_attachment(output, how.attachment, found.tares, loaded, [(p.name, file_sha256(p)) for p in recordings])
    return found


def _check_recordings(loaded: Loaded, recordings: Sequence[Path], lift: Path | None) -> None:
    """Check that each recording is named once and is of this machine. Raises RecordingError."""
    for path, more in combinations(recordings, 2):
        if path.resolve() == more.resolve():
            raise RecordingError(f"{path}: is named twice, so that its motion would count double: name it once")
    for path in (*recordings, *([lift] if lift else [])):
        check_machine(path, log_header(path), loaded)


def _then_fit(loaded: Loaded, recordings: Sequence[Path], watch: Watch, tell: Report) -> Iterator[Array]:
    for _, segment in named_segments(loaded, recordings, watch, tell):
        yield segment
    watch("fitting, choosing friction laws", None)


def run_seal(loaded: Loaded, path: Path, reason: str) -> None:
    """Accept a file of tares in its present state, and print its changes. Raises SettingsError or RecordingError."""
    if not reason.strip():
        raise RecordingError("--reason: say in a few words why the file was changed")
    check_outputs((path,))
    changed, seal = seal_again(path, loaded, reason.strip())
    print(f"changed since it was sealed: {', '.join(changed) or 'nothing'}")
    print(f"{path}: seal {seal.counter}, {seal.sha256[:16]}, by {seal.who}, {seal.date}: {seal.reason}")


def show(found: Identification, console: Console) -> None:
    """Print a table of the parameters with the prior and the source of each."""
    model = found.model
    error = np.sqrt(np.diag(found.tares.covariance))
    rows = []
    for k, p in enumerate(model.parameters):
        numbers = (f"{model.prior.mean[k]:.5g}", f"{found.tares.values[k]:.5g}", f"{error[k]:.3g}")
        rows.append((p.name, p.unit, *numbers, "data sheet" if p.name in found.not_identified else ""))
    right = ("usual" if model.usual else "data sheet", "identified", "standard error")
    header = ("parameter", "unit", *right, "from")
    print_table(console, header, rows, right, f"{found.seconds:.0f} s of motion")
    names = [model.machine.links[j].name for j in model.machine.rows]
    left = ", ".join(f"{n} {e:.0f} N m" for n, e in zip(names, found.tares.row_error, strict=True))
    console.print(f"unexplained torque (rms): {left}")
    shares = (f"{n} {_percent(share)}" for n, share in zip(names, found.explained, strict=True))
    console.print(f"explained share of the variance of the torque: {', '.join(shares)}")
    tried = ", ".join(f"{law} {error:.3f}" for law, error in found.held_out.items())
    errors = f" (mean squared error in data left out of the fit: {tried})" if tried else ""
    console.print(f"friction: {', '.join(model.friction)}{errors}")
    if found.scale_measured:
        console.print(f"scale from the known weight: {found.tares.scale:.4f} +- {found.tares.scale_error:.4f}")
    elif found.by_masses is not None:
        console.print(without_known_weight(found.tares, found.by_masses))
    for sentence in found.violations:
        console.print(f"[bold]not physical:[/bold] {sentence}; --enforce finds the nearest tares that are")
    for sentence in found.warnings:
        if sentence not in found.violations:
            console.print(f"[bold red]warning:[/bold red] {escape(sentence)}")


def without_known_weight(tares: Tares, by_masses: CommonScale) -> str:
    """Return a sentence on the error of the scale without a known weight, and the cure."""
    return (
        f"scale: no known weight was lifted; the identified masses are {by_masses.factor:.3f} +- "
        f"{by_masses.standard_error:.3f} times those of the data sheet, so that every weight is known to +- "
        f"{100.0 * tares.reported_scale_error:.1f} % only: lift a known weight (--lift, --known-kg)"
    )


def _percent(share: float) -> str:
    return "not seen" if np.isnan(share) else f"{100.0 * share:.2f} %"
