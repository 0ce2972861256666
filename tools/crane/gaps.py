"""Why a real crane differs from its data sheet, and from the model that was identified from one run: what the diagnosis
names, how well that predicts runs that it has not seen, and what it answers where the clocks of pressures and positions
drift apart."""

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from cylforce.diagnosis.explain import Cause
from cylforce.estimation.model import Model
from cylforce.files.atomic import RecordingError
from cylforce.mechanics.machine import Machine
from cylforce.programs.common.gap_question import Question
from cylforce.programs.gap import Diagnosed, diagnose
from cylforce.programs.identify import run_identify
from cylforce.programs.wording.plain import headline
from cylforce.readings.clocks import clock_faults
from cylforce.readings.recording import Recording
from cylforce.settings.machine_file import Loaded, load

from .figures import FITTED, data_sheet, number, recordings, samples
from .geometry import crane
from .machine_file import text
from .measure import Run, measured

USED = ("JibSineTest", FITTED, "Dual2SineTest", "Dual2SineTestFlowShare")
PRESSURES = ("MainPaCyl", "JibPaCyl", "JibPbCyl")  # on the other time base, as it really was; MainPbDCV was not
SLIPPED = {"boom_head_pressure", "jib_head_pressure", "jib_rod_pressure"}  # what the diagnosis should name then
MARCH = "_270325"  # another day
PERIODS = 5.0 / 10.0  # of the pressures, once they are resampled, and of the positions
LAWS = ("coulomb", "viscous", "load_dependent", "directional")
TOGETHER = "all four so, together"
GRAVITY_AND_COULOMB = ("X", "Z", "coulomb")  # parameters of the least-squares fit beside


class Answer(NamedTuple):
    """What the diagnosis says: the verdict, a sentence, the causes {name, at, sizes, errors, units, confused_with}, the
    gap [N m] by joint {fixed, refit, after, floor}, warnings, and the parameters {name, unit, before, after, torque} of
    a data sheet that would change by more torque than what remains unexplained."""

    verdict: str
    sentence: str
    causes: list[dict[str, Any]]
    joints: dict[str, dict[str, float]]
    warnings: list[str]
    parameters: list[dict[str, Any]]


class Unseen(NamedTuple):
    """Unexplained torque [N m] by joint of runs that neither names nor sizes come from: by the data sheet, with the
    causes, with least squares; the causes' names, and those that `lack` a parameter and so predict nothing."""

    sheet: list[float | None]
    causes: list[float | None]
    least_squares: list[float | None]
    names: list[str]
    lack: list[str]


class Gaps(NamedTuple):
    """All figures: answers by what is compared; unexplained torque by run left out, of these runs together, and of all
    other runs predicted from one."""

    joints: tuple[str, ...]
    answers: dict[str, Answer]
    unseen: dict[str, Unseen]
    clocks: dict[str, list[dict[str, Any]]]


def gaps(folder: Path, work: Path, quick: bool = False) -> Gaps:
    """All figures; with `quick` only those of the data sheet and of the clocks; `work` takes the
    machine file, the tares and the recordings with clocks that drift apart."""
    (work / "crane.toml").write_text(text(crane(folder)))
    loaded = load(work / "crane.toml")
    paths = recordings(folder)
    joints = tuple(loaded.service.machine.links[j].name for j in loaded.service.machine.rows)
    asked = sheet_questions(paths, work)
    if not quick:
        run_identify(loaded, [paths[FITTED]], work / "identified.toml")
        asked |= identified_questions(paths, work / "identified.toml")
        march = tuple(sorted(folder.glob(f"Jib*{MARCH}.csv")))
        asked["the jib in March, April as reference"] = Question(march, tuple(paths.values()))
        run_identify(loaded, list(paths.values()), work / "april.toml")
        asked["the jib in March, identified in April"] = Question(march, identified=work / "april.toml")
    machine = loaded.service.machine
    answers = {name: _answer(machine, diagnose(loaded, question)) for name, question in asked.items()}
    found = Unknown(loaded, paths)
    days = paths | {path.stem: path for path in sorted(folder.glob(f"*{MARCH}.csv"))}
    return Gaps(joints, answers, found.by_others() | found.by_one(), clocks(loaded, days, work))


def sheet_questions(paths: Mapping[str, Path], work: Path) -> dict[str, Question]:
    """What is asked of the data sheet, also with clocks that drift apart."""
    late = tuple(trapped(paths[name], work) for name in USED)
    return {
        "data sheet": Question(tuple(paths[name] for name in USED)),
        f"data sheet, {FITTED}": Question((paths[FITTED],)),
        "data sheet, all runs": Question(tuple(paths.values())),
        "clocks drift apart, four runs": Question(late),
        f"clocks drift apart, {FITTED}": Question(late[USED.index(FITTED) : USED.index(FITTED) + 1]),
    }


def identified_questions(paths: Mapping[str, Path], identified: Path) -> dict[str, Question]:
    """What is asked of the model identified on one run."""
    others = tuple(path for name, path in paths.items() if name != FITTED)
    return {
        f"identified on {FITTED}": Question(others, identified=identified),
        f"the same, with {FITTED} as reference": Question(others, (paths[FITTED],), identified),
    }


def trapped(path: Path, work: Path) -> Path:
    """The recording with its pressures resampled to 5 ms, and sample k of them beside sample k of the positions."""
    header = path.read_text().splitlines()[0]
    values = np.loadtxt(path, delimiter=",", skiprows=1)
    k = np.arange(len(values))
    for name in PRESSURES:
        column = header.split(",").index(name)
        values[:, column] = np.interp(PERIODS * k, k, values[:, column])
    np.savetxt(work / path.name, values, fmt="%.9g", delimiter=",", header=header, comments="")
    return work / path.name


def clocks(loaded: Loaded, paths: Mapping[str, Path], work: Path) -> dict[str, list[dict[str, Any]]]:
    """What is said of the clocks of each run in order, and of each with the time-base fault, by itself."""
    model, found = Model(loaded.service.machine, loaded.service.filters, ()), dict[str, list[dict[str, Any]]]()
    for name, path in paths.items():
        for title, file in ((name, path), (f"{name}, time-base fault", trapped(path, work))):
            told = clock_faults(model, [Recording(file.name, samples(loaded, file))])
            found[title] = [
                {"sensors": list(s.sensors), "last_s": s.last, "error_s": float(s.errors[1]), "nats": s.nats}
                for s in told
            ]
    return found


def clock_table(found: Gaps) -> Table:
    """Clocks of single runs."""
    table = Table(title="Clocks of each run by itself (pressures on another clock, how late at the end)")
    for column in ("run", "pressures", "late"):
        table.add_column(column, overflow="fold")
    for name, each in found.clocks.items():
        sensors = "; ".join(", ".join(slip["sensors"]) for slip in each)
        late = "; ".join(f"{slip['last_s']:.1f} +- {slip['error_s']:.1f} s" for slip in each)
        table.add_row(name, sensors or "-", late or "-")
    return table


def _answer(machine: Machine, found: Diagnosed) -> Answer:
    answer = found.answer
    return Answer(
        answer["verdict"],
        headline(machine, answer),
        [_cause(each.cause, e) for each, e in zip(found.diagnosis.named, answer["effects"], strict=True)]
        if found.diagnosis
        else [{"name": e["name"], "at": e["at"], **_size(e), "confused_with": []} for e in answer["effects"]],
        answer["gap"]["joints"] if "gap" in answer else {},
        answer.get("warnings", []),
        answer.get("identify_first", {}).get("parameters", []),
    )


def _cause(cause: Cause, effect: Mapping[str, Any]) -> dict[str, Any]:
    proposal = cause.proposal
    units = getattr(proposal.group[0], "units", (proposal.about.unit,))
    sizes = {"sizes": cause.sizes.ravel().tolist(), "errors": cause.errors.ravel().tolist(), "units": list(units)}
    return {"name": effect["name"], "at": effect["at"], **sizes, "confused_with": effect["confused_with"]}


def _size(effect: Mapping[str, Any]) -> dict[str, Any]:
    size = effect["parameters"]["size"]
    return {"sizes": [size["value"]], "errors": [(size["high"] - size["low"]) / 3.29], "units": [size["unit"]]}


class Unknown:
    """The four runs, each as one that the diagnosis has not seen."""

    def __init__(self, loaded: Loaded, paths: Mapping[str, Path]) -> None:
        self.loaded, self.paths = loaded, paths
        self.model = Model(loaded.service.machine, loaded.service.filters, LAWS)
        self.runs = {name: measured(self.model, samples(loaded, paths[name])) for name in USED}

    def fitted(self, names: Sequence[str]) -> "Fits":
        """Parameters from some runs."""
        paths = {name: self.paths[name] for name in names}
        return fitted(self.loaded, self.model, paths, [self.runs[name] for name in names])

    def by_others(self) -> dict[str, Unseen]:
        """Each run by the other three."""
        pairs = {name: (self.runs[name], self.fitted([other for other in USED if other != name])) for name in USED}
        found = {f"{name}, by the other three": left([pair]) for name, pair in pairs.items()}
        return found | {TOGETHER: left(list(pairs.values()))}

    def by_one(self) -> dict[str, Unseen]:
        """The other three by one."""
        fits = self.fitted([FITTED])
        return {f"the other three, by {FITTED}": left([(self.runs[name], fits) for name in USED if name != FITTED])}


class Fits(NamedTuple):
    """Parameters (P,) by the data sheet, the diagnosis and least squares; names of the causes, and of those without a
    parameter."""

    sheet: np.ndarray
    causes: np.ndarray
    least_squares: np.ndarray
    names: list[str]
    lack: list[str]


def fitted(loaded: Loaded, model: Model, paths: Mapping[str, Path], runs: Sequence[Run]) -> Fits:
    """Parameters from some runs: what the answer for a data sheet says that identifying the machine would find."""
    found = diagnose(loaded, Question(tuple(paths.values())))
    sheet = data_sheet(model)
    if found.sheet is None:
        return Fits(sheet, sheet, least_squares(model, runs), [], [])
    values = {change.name: change.after for change in found.sheet.refit.changes}
    causes = np.array([values.get(p.name, value) for p, value in zip(model.parameters, sheet.tolist(), strict=True)])
    names = [change.name for change in found.sheet.refit.clear]
    return Fits(sheet, causes, least_squares(model, runs), names, [])


def least_squares(model: Model, runs: Sequence[Run]) -> np.ndarray:
    """Gravity and Coulomb friction by least squares, inertias as the data sheet has them."""
    found, names = data_sheet(model), [p.name for p in model.parameters]
    free = [k for k, name in enumerate(names) if name.split(".")[1] in GRAVITY_AND_COULOMB]
    found[free] = 0.0
    columns = np.concatenate([run.columns[run.counts] for run in runs])
    torque = np.concatenate([run.torque[run.counts] for run in runs])
    found[free] = np.linalg.lstsq(columns[:, free], torque - columns @ found)[0]
    return found


def left(pairs: Sequence[tuple[Run, Fits]]) -> Unseen:
    """What is left of runs by what was fitted for each."""
    return Unseen(
        sheet=_rms([(run, fits.sheet) for run, fits in pairs]),
        causes=_rms([(run, fits.causes) for run, fits in pairs]),
        least_squares=_rms([(run, fits.least_squares) for run, fits in pairs]),
        names=sorted({name for _, fits in pairs for name in fits.names}),
        lack=sorted({name for _, fits in pairs for name in fits.lack}),
    )


def _rms(pairs: Sequence[tuple[Run, np.ndarray]]) -> list[float | None]:
    """By joint, of all runs together; None where it never moves."""
    rows = range(pairs[0][0].torque.shape[1])
    left = [[(run.torque - run.columns @ fit)[run.counts[:, r], r] for run, fit in pairs] for r in rows]
    return [float(np.sqrt(np.mean(e**2))) if (e := np.concatenate(parts)).size else None for parts in left]


def closed(before: float | None, after: float | None) -> float | None:
    """Share of the energy that is gone [%]."""
    return None if before is None or after is None else 100.0 * (1.0 - after**2 / before**2)


def answer_table(found: Gaps) -> Table:
    """What is named."""
    table = Table(title="What the diagnosis says (gap: N m with fixed parameters, refitted, with the causes, floor)")
    for column in ("against", "verdict", "cause", "size +- standard error", "may be", *found.joints):
        table.add_column(column, overflow="fold")
    for name, answer in found.answers.items():
        sizes = [
            " / ".join(number(answer.joints[j][key]) for key in GAP) if answer.joints else "-" for j in found.joints
        ]
        causes = [(f"{c['name']} at {c['at']}", _in_words(c), _confused(c)) for c in answer.causes] or [("-", "", "")]
        for k, cause in enumerate(causes):
            head = (name, answer.verdict) if k == 0 else ("", "")
            table.add_row(*head, *cause, *(sizes if k == 0 else ("",) * len(sizes)))
        table.add_section()
    return table


GAP = ("fixed", "refit", "after", "floor")


def _in_words(cause: Mapping[str, Any]) -> str:
    parts = zip(cause["sizes"], cause["errors"], cause["units"], strict=False)
    return ", ".join(f"{size:.4g} +- {error:.2g} {unit}" for size, error, unit in parts)


def _confused(cause: Mapping[str, Any]) -> str:
    return ", ".join(other["name"] for other in cause["confused_with"])


def unseen_table(found: Gaps) -> Table:
    """What is left of runs that were not seen."""
    table = Table(title="Unexplained torque while moving, rms in N m, of runs that the diagnosis has not seen")
    table.add_column("run")
    for joint in found.joints:
        for column in (f"{joint}: sheet", "causes", "closed %", "least squares", "closed %"):
            table.add_column(column, justify="right")
    for name, each in found.unseen.items():
        cells = []
        for sheet, causes, fit in zip(each.sheet, each.causes, each.least_squares, strict=True):
            cells += [number(sheet), number(causes), number(closed(sheet, causes), 1)]
            cells += [number(fit), number(closed(sheet, fit), 1)]
        table.add_row(name, *cells)
    return table


def show(found: Gaps, console: Console) -> None:
    """All tables."""
    console.print(answer_table(found))
    for name, answer in found.answers.items():
        for line in (answer.sentence, *answer.warnings) if not answer.causes or answer.warnings else ():
            console.print(f"{name}: {line}")
    console.print(clock_table(found))
    console.print(unseen_table(found))
    for name, each in found.unseen.items():
        lack = f"; without a parameter, and so without effect here: {', '.join(each.lack)}" if each.lack else ""
        console.print(f"{name}: {', '.join(each.names) or 'nothing'}{lack}")


def as_json(found: Gaps) -> dict[str, Any]:
    """The figures."""
    unseen = {}
    for name, each in found.unseen.items():
        figures = each._asdict() | {
            "closed_percent": [closed(a, b) for a, b in zip(each.sheet, each.causes, strict=True)],
            "least_squares_closed_percent": [closed(a, b) for a, b in zip(each.sheet, each.least_squares, strict=True)],
        }
        by_joint = {
            k: dict(zip(found.joints, v, strict=True)) for k, v in figures.items() if k not in ("names", "lack")
        }
        unseen[name] = by_joint | {"names": each.names, "lack": each.lack}
    answers = {name: answer._asdict() for name, answer in found.answers.items()}
    return {"answers": answers, "unseen": unseen, "clocks": found.clocks}


def main() -> int:
    """Diagnose and print; exit code 2 where the folder lacks something."""
    parser = argparse.ArgumentParser(prog="crane_gap", description=__doc__)
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="with the recordings and the crane's parameters")
    parser.add_argument("--json", type=Path, metavar="OUT", help="write the figures there, too")
    parser.add_argument("--quick", action="store_true", help="without what is said of the identified model")
    options = parser.parse_args()
    try:
        with TemporaryDirectory() as work:
            found = gaps(options.folder, Path(work), options.quick)
    except (OSError, ValueError, KeyError, RecordingError) as error:
        print(f"crane_gap: {error}", file=sys.stderr)
        return 2
    show(found, Console(highlight=False))
    if options.json:
        options.json.write_text(json.dumps(as_json(found), indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
