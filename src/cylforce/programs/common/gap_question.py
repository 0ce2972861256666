"""What is asked of `cylforce gap`, and whether it can be answered."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from cylforce.effects.fault import places
from cylforce.effects.library import Group
from cylforce.files.atomic import RecordingError
from cylforce.mechanics.machine import Machine

EXAMPLE = "field.log=1000"


class Question(NamedTuple):
    """What is asked.

    field:      recordings of the machine that differs
    reference:  recordings of the same machine while it was healthy
    identified: file of `cylforce identify`
    loads:      known loads [kg] by file name
    only:       NAME@AT of the one effect that is examined
    without:    names of effects that are left out of the library
    usual:      file of what is usual for the type
    simulation: recordings of the user's own simulation
    still:      recording of the machine without pressure, for the zeros of its pressure sensors
    """

    field: tuple[Path, ...]
    reference: tuple[Path, ...] = ()
    identified: Path | None = None
    loads: dict[str, float] = {}  # noqa: RUF012
    only: str | None = None
    without: tuple[str, ...] = ()
    usual: Path | None = None
    simulation: tuple[Path, ...] = ()
    still: Path | None = None

    @property
    def healthy(self) -> tuple[Path, ...]:
        """Recordings with which the field is compared: references, or those of a simulation."""
        return self.reference or self.simulation


def known_loads(words: Sequence[str]) -> dict[str, float]:
    """Return loads [kg] by file name, from words FILE=KG. Raises RecordingError."""
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
    """Check that every recording and load is named once, and rightly. Raises RecordingError."""
    if question.reference and question.simulation:
        raise RecordingError(
            "--reference and --simulation: the field is compared with one of them: leave out --simulation, or diagnose "
            "the references against the simulation first"
        )
    for option, paths in (("--reference", question.reference), ("--simulation", question.simulation)):
        for path in {path.resolve() for path in question.field} & {path.resolve() for path in paths}:
            raise RecordingError(f"{path}: is named as field and as {option}: name it as one of them")
    listed = [path.name for path in (*question.field, *question.healthy)]
    if twice := [name for name in listed if listed.count(name) > 1]:
        raise RecordingError(f"{twice[0]}: several recordings have this name: name each once, and rename others")
    names = set(listed)
    for name, kilograms in question.loads.items():
        if name not in names:
            raise RecordingError(f"--load {name}: is none of the recordings ({', '.join(sorted(names))})")
        if not 0.0 <= kilograms < 1e6:
            raise RecordingError(f"--load {name}={kilograms:g}: is no weight in kg")


def only_effect(library: tuple[Group, ...], only: str | None, machine: Machine) -> tuple[str, str] | None:
    """Return name and place ("": any) of the one effect that is examined. Raises ValueError."""
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
    """Return the library without the effects of these names. Raises ValueError."""
    names = {group[0].about.name for group in library}
    for name in without:
        if name not in names:
            raise ValueError(_not_known(name, library))
    return tuple(group for group in library if group[0].about.name not in without)


def _not_known(name: str, library: tuple[Group, ...]) -> str:
    known = ", ".join(dict.fromkeys(group[0].about.name for group in library))
    return f"effect {name!r} is not known: choose one of {known}"
