"""`cylforce new`: a first machine file from the type of a machine and the figures of its data sheet."""

import shlex
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from cylforce.files.atomic import RecordingError, check_outputs, replacing
from cylforce.files.shipped import shipped
from cylforce.mechanics.workspace import working_range
from cylforce.settings.machine_file import SettingsError, load
from cylforce.settings.proposal.figures import Figure, Value, figures, parsed, settings
from cylforce.settings.proposal.scaling import ProposedMachine, proposal
from cylforce.settings.proposal.types import TYPES, machine_type, operating_mass
from cylforce.settings.proposal.writing import text

Ask = Callable[[str], str]
NODE_ID = ".node_id"
YES = ("y", "yes")


class GivenFigures(NamedTuple):
    """Figures from the options.

    type:   type of the machine; None: to be asked for
    tonnes: operating mass [t]; None: to be asked for
    texts:  figures as KEY=VALUE
    yes:    whether all other figures have their typical values without a question
    """

    type: str | None
    tonnes: str | None
    texts: Sequence[str]
    yes: bool


class Answers(NamedTuple):
    """Figures of a machine.

    type:   name of its type
    tonnes: operating mass [t]
    values: value of every figure
    given:  keys of figures that were given
    """

    type: str
    tonnes: float
    values: dict[str, Value]
    given: frozenset[str]


def run_new(given: GivenFigures, output: Path, ask: Ask = input) -> None:
    """Ask for missing figures, and write the machine file. Raises SettingsError or RecordingError with a sentence."""
    if output.exists():
        raise RecordingError(f"{output}: exists and is not replaced: choose another file with -o, or remove it first")
    if output.suffix != ".toml":
        raise RecordingError(f"-o {output}: must end in .toml: by that ending it is read again")
    check_outputs((output,))
    answers = gathered(given, ask)
    try:
        warnings = write(answers, output)
    except ValueError:
        if not given.yes:
            print(f"Your answers as one command, to be corrected:\n{command(answers, output)}")
        raise
    print(
        f"{output}: {answers.values['name']}; {len(answers.given)} figures from the data sheet, the others are typical"
    )
    print("Every pin is a guess: search the file for MEASURE THIS. Heavy loads are not booked until the pins are")
    print(
        "measured (then set pins_m to the accuracy of the measurement) or a known weight was lifted (identify --lift)."
    )
    for warning in warnings:
        print(f"warning: {warning}")
    print(f"Next: cylforce describe {output} --svg {output.with_suffix('.svg')}")


def gathered(given: GivenFigures, ask: Ask) -> Answers:
    """Return all figures, from the options, from answers, or typical."""
    name = given.type if given.type or given.yes else _type(ask)
    if name is None:
        raise SettingsError(f"--type is missing: write one of {', '.join(TYPES)}")
    tonnes = _tonnes(given, ask)
    known = wanted(name, tonnes)
    values = {key: figure.typical for key, figure in known.items()}
    found = settings(given.texts, known)
    if not given.yes:
        found |= _answers([figure for key, figure in known.items() if key not in found], ask)
    values |= found
    return Answers(name, tonnes, values, frozenset(found))


def command(answers: Answers, output: Path) -> str:
    """Return the command line with all these answers."""
    known = wanted(answers.type, answers.tonnes)
    words = ["cylforce", "new", "-o", str(output), "--type", answers.type, "--tonnes", f"{answers.tonnes:.10g}"]
    for key in known:
        if key in answers.given:
            words += ["--set", f"{key}={_text(answers.values[key])}"]
    return shlex.join([*words, "--yes"])


def wanted(name: str, tonnes: float) -> dict[str, Figure]:
    """Return the figures of a type by key."""
    kind = machine_type(name)
    return {figure.key: figure for figure in figures(kind, tomllib.loads(_example(name)), tonnes)}


def _example(name: str) -> str:
    return shipped(machine_type(name).example).read_text(encoding="utf-8")


def _type(ask: Ask) -> str:
    for name, kind in TYPES.items():
        print(f"  {name:13} {kind.words}")
    while True:
        answer = _said(ask, f"type of machine [{next(iter(TYPES))}]: ", "--type") or next(iter(TYPES))
        if answer in TYPES:
            return answer
        print(f"  {answer!r} is none of them")


def _tonnes(given: GivenFigures, ask: Ask) -> float:
    if given.tonnes is not None:
        return operating_mass(given.tonnes)
    if given.yes:
        raise SettingsError("--tonnes is missing: give the operating mass from the data sheet, in tonnes")
    while True:
        try:
            return operating_mass(_said(ask, "operating mass [t]: ", "--tonnes"))
        except SettingsError:
            raise
        except ValueError as error:
            print(f"  {error}")


def _answers(asked: Sequence[Figure], ask: Ask) -> dict[str, Value]:
    """Return the answers about figures, by key; node ids are asked for only on request."""
    nodes = [figure for figure in asked if figure.key.endswith(NODE_ID)]
    print(f"{len(asked) - len(nodes)} figures; Enter takes the value in brackets")
    said = {figure.key: _answer(figure, ask) for figure in asked if figure not in nodes}
    if (
        nodes
        and _said(ask, f"ask for {len(nodes)} CANopen node ids as well? [no]: ", f"--set {nodes[0].key}").lower() in YES
    ):
        said |= {figure.key: _answer(figure, ask) for figure in nodes}
    return {key: value for key, value in said.items() if value is not None}


def _answer(figure: Figure, ask: Ask) -> Value:
    """Return the answer about a figure, asked again until it is valid; None for Enter."""
    shown = "from the rest" if figure.typical is None else _text(figure.typical)
    while True:
        answer = _said(ask, f"{figure.words} [{shown}]: ", f"--set {figure.key}")
        if not answer:
            return None
        try:
            return parsed(figure, answer)
        except ValueError as error:
            print(f"  {error}")


def _said(ask: Ask, question: str, option: str) -> str:
    try:
        return ask(question).strip()
    except EOFError:
        print()
        raise SettingsError(
            f"{option} was asked for and the input ended: answer, give the option, or take typical values with --yes"
        ) from None


def _text(value: Value) -> str:
    if isinstance(value, tuple):
        return ":".join(f"{part:.10g}" for part in value)
    return f"{value:.10g}" if isinstance(value, float) else str(value)


def _check_nodes(values: Mapping[str, Value]) -> None:
    seen: dict[Value, str] = {}
    for key, value in values.items():
        if key.endswith(NODE_ID) and (other := seen.setdefault(value, key)) != key:
            raise SettingsError(f"{key} is {value}, which is also {other}: give each node its own id, 1 to 127")


def write(answers: Answers, output: Path) -> tuple[str, ...]:
    """Write the machine file, checked before it replaces the output; return warnings."""
    _check_nodes(answers.values)
    kind, example = machine_type(answers.type), _example(answers.type)
    found = proposal(kind, tomllib.loads(example), answers.tonnes, answers.values, answers.given)
    made = text(kind, example, found, answers.tonnes, answers.given)
    with replacing(output) as temporary:
        temporary.write_text(made, encoding="utf-8")
        return (*_narrowed(answers, found), *_warnings(temporary, output))


def _narrowed(answers: Answers, found: ProposedMachine) -> Iterator[str]:
    """Yield sentences on typical angle ranges that were narrowed to fit the cylinders."""
    known = wanted(answers.type, answers.tonnes)
    for key, kept in found.narrowed.items():
        words = known[key].words.partition(": ")[2].partition(", ")[2].removesuffix(" [deg]")
        yield (
            f"{key}: the typical {_text(known[key].typical)} deg {words} is more than the cylinder can cover and was "
            f"narrowed to {_text(kept)}: measure both ends, then give them with --set {key}=LOW:HIGH"
        )


def _warnings(temporary: Path, output: Path) -> tuple[str, ...]:
    """Return the warnings of the checks, once the file can be loaded and its machine can be moved."""
    try:
        loaded = load(temporary)
        working_range(loaded.service.machine)
        return tuple(warning.replace(str(temporary), str(output)) for warning in loaded.warnings)
    except ValueError as error:
        problem = "; ".join(str(error).replace(str(temporary), str(output)).splitlines())
        raise SettingsError(f"these figures give no machine ({problem}): correct them with --set") from error


def list_figures(given: GivenFigures) -> None:
    """Print the keys for --set, with typical values and limits for a type and operating mass."""
    if given.type is None or given.tonnes is None:
        raise SettingsError(f"--list needs --type ({', '.join(TYPES)}) and --tonnes: typical values follow from them")
    print(f"{'key':24} {'typical':15} {'limits':15} what")
    for key, figure in wanted(given.type, _tonnes(given, input)).items():
        typical = "from the rest" if figure.typical is None else _text(figure.typical)
        limits = "" if figure.shape is str else f"{figure.low:g}:{figure.high:g}"
        print(f"{key:24} {typical:15} {limits:15} {figure.words}")
