"""What is asked of `cylforce gap`, and whether it can be."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from cylforce.effects.fault import places
from cylforce.effects.library import Group
from cylforce.files.atomic import RecordingError
from cylforce.mechanics.machine import Machine

EXAMPLE = "field.log=1000"


class Question(NamedTuple):
    """What is asked: faulty recordings, clean ones, known loads [kg] by file name, tares, `only` NAME@AT; `without`:
    names of effects that are left out of the library; `usual`: a file of what is usual for the type."""

    field: tuple[Path, ...]
    reference: tuple[Path, ...] = ()
    identified: Path | None = None
    loads: dict[str, float] = {}  # noqa: RUF012
    only: str | None = None
    without: tuple[str, ...] = ()
    usual: Path | None = None


def known_loads(words: Sequence[str]) -> dict[str, float]:
    """Loads [kg] by file name, from words FILE=KG. Raises RecordingError."""
    found = {}
    for word in words:
        name, _, kilograms = word.rpartition("=")
        try:
            found[Path(name).name] = float(kilograms)
        except ValueError:
            name = ""
        if not name:
            raise RecordingError(f"--load {word}: write the recording's name, =, and the load in kg, e.g. {EXAMPLE}")
    return found


def check_recordings(question: Question) -> None:
    """Whether every recording and load is named once, and rightly. Raises RecordingError."""
    both = {path.resolve() for path in question.field} & {path.resolve() for path in question.reference}
    for path in both:
        raise RecordingError(f"{path}: is named as field and as --reference: name it as one of them")
    listed = [path.name for path in (*question.field, *question.reference)]
    if twice := [name for name in listed if listed.count(name) > 1]:
        raise RecordingError(f"{twice[0]}: several recordings have this name: name each once, and rename others")
    names = set(listed)
    for name, kilograms in question.loads.items():
        if name not in names:
            raise RecordingError(f"--load {name}: is none of the recordings ({', '.join(sorted(names))})")
        if not 0.0 <= kilograms < 1e6:
            raise RecordingError(f"--load {name}={kilograms:g}: is no weight in kg")


def asked_only(library: tuple[Group, ...], only: str | None, machine: Machine) -> tuple[str, str] | None:
    """Name and place ("": any) of the one effect that is asked for."""
    if only is None:
        return None
    name, _, at = only.partition("@")
    found = [group for group in library if group[0].about.name == name]
    if not found:
        raise ValueError(_not_known(name, library))
    place = found[0][0].about.place
    there = [where for where, _ in places(machine, place)]
    if at and at not in there:
        raise ValueError(f"effect {name!r} sits at {at!r}, which is no {place}: choose one of {', '.join(there)}")
    return name, at


def reduced(library: tuple[Group, ...], without: Sequence[str]) -> tuple[Group, ...]:
    """The library without the effects of these names."""
    names = {group[0].about.name for group in library}
    for name in without:
        if name not in names:
            raise ValueError(_not_known(name, library))
    return tuple(group for group in library if group[0].about.name not in without)


def _not_known(name: str, library: tuple[Group, ...]) -> str:
    known = ", ".join(dict.fromkeys(group[0].about.name for group in library))
    return f"effect {name!r} is not known: choose one of {known}"
