"""Faults of a machine file, each with file, line, key, limit and cure; all faults of a file together."""

import re
from collections.abc import Callable, Iterable, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import NamedTuple, ParamSpec, TypeVar

Key = tuple[str | int, ...]
P = ParamSpec("P")
T = TypeVar("T")

# Kinds of linkages, which pydantic puts into keys; the file has no such part of a key.
TAGS = ("triangle", "four_bar", "dogbone")
UNITS = {
    "kg_m2": "kg m^2",
    "m_s": "m/s",
    "percent": "per cent",
    "kg": "kg",
    "mm": "mm",
    "deg": "degrees",
    "bar": "bar",
    "hz": "Hz",
    "ms": "ms",
    "n": "N",
    "m": "m",
}


class SettingsError(ValueError):
    """A machine file that cannot be used.

    Its text is one sentence with file, line, key and cure. Where there are several errors, it is a first line with the
    file and their number, then one such sentence on each line.
    """


class FaultError(ValueError):
    """A fault at a key; `load` adds file and line.

    Its text follows the key in the sentence of a message: problem, limit and cure.

    key: path of the key in the file, numbers counting the tables of an array from 0
    missing: keys of which one is missing
    unknown: whether the key itself is not one that its table has
    """

    def __init__(
        self, key: Sequence[str | int], problem: str, missing: Sequence[str] = (), *, unknown: bool = False
    ) -> None:
        super().__init__(problem)
        self.key = tuple(part for part in key if part not in TAGS)
        self.missing, self.unknown = tuple(missing), unknown


class Inspection:
    """Collector of faults of a machine file.

    errors: faults that prevent its use
    warnings: unusual values
    """

    def __init__(self) -> None:
        self.errors: list[FaultError] = []
        self.warnings: list[FaultError] = []

    def refuse(self, key: Key, problem: str) -> None:
        """Add an error."""
        self.errors.append(FaultError(key, problem))

    def warn(self, key: Key, problem: str) -> None:
        """Add a warning."""
        self.warnings.append(FaultError(key, problem))

    def attempt(self, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T | None:
        """Return a function's result; None when it raises FaultError, which is added to the errors."""
        try:
            return function(*args, **kwargs)
        except FaultError as fault:
            self.errors.append(fault)
            return None


class Source(NamedTuple):
    """A file in which the line of a key can be found.

    path: its path
    text: its text
    raw: its content as parsed from TOML
    """

    path: Path
    text: str
    raw: object


def error_text(source: Source, faults: Iterable[FaultError]) -> str:
    """Return the text of a SettingsError: its errors in the order of the file, equal sentences once.

    A missing key and its misspelling are one error.
    """
    lines = sentences(source, _with_misspellings_merged(list(faults)))
    if len(lines) == 1:
        return lines[0]
    return "\n".join([f"{source.path}: {len(lines)} errors", *lines])


def sentences(source: Source, faults: Iterable[FaultError]) -> tuple[str, ...]:
    """Return each fault as one sentence with file, line and key, in the order of the file; equal sentences once."""
    keys = [(written_key(source.raw, fault.key), fault) for fault in faults]
    lines = sorted(((line_of(source.text, key), key, fault) for key, fault in keys), key=lambda entry: entry[0])
    texts = [f"{source.path}:{line}: {dotted(source.raw, key)} {fault}" for line, key, fault in lines]
    return tuple(dict.fromkeys(texts))


def _with_misspellings_merged(faults: list[FaultError]) -> list[FaultError]:
    """Return the faults, those of a missing key and of an unknown key spelt like it in the same table as one.

    The merged fault is at the unknown key.
    """
    for lacking in [fault for fault in faults if fault.missing]:
        beside = {str(f.key[-1]): f for f in faults if f.unknown and f.key[:-1] == lacking.key}
        for name in lacking.missing:
            close = get_close_matches(name, beside, 1)
            if close:
                misspelt = beside[close[0]]
                both = FaultError(
                    misspelt.key, f"{str(misspelt).split(':')[0]}: did you mean {name}, which is missing?"
                )
                faults = [f for f in faults if f not in (lacking, misspelt)] + [both]
                break
    return faults


def line_of(text: str, key: Key) -> int:
    """Return the line (from 1) of a key, or of the nearest table around it that can be found without parsing.

    It is 1 where nothing of the key is found.

    text: text of the file
    """
    lines, at = text.splitlines(), 0
    end = len(lines)
    for k, part in enumerate(key):
        if isinstance(part, int):
            continue
        after = key[k + 1] if k + 1 < len(key) else 0
        hits = _matches(lines[:end], at, rf"\s*\[+\s*([\w.]+\.)?{re.escape(part)}\s*\]")
        if isinstance(after, int) and after < len(hits):
            at = hits[after]  # the n-th of several tables; else the n-th of an array's values, which is on its line
            end = hits[after + 1] if after + 1 < len(hits) else _end(lines, at)
            continue
        hits = hits or _matches(lines[:end], at, rf"(.*[\s{{,.])?{re.escape(part)}\s*[.=]")
        hits = hits or _matches(lines[:end], at, rf"\s*\[+\s*{re.escape(part)}\.[\w.]+\s*\]")
        if not hits:
            break
        at = hits[0]
    return at + 1


def _end(lines: list[str], header: int) -> int:
    """Return the number (from 0) of the line at which a table ends: of the next header that does not belong to it.

    header: number (from 0) of the line with the header of the table
    """
    name = lines[header].strip().strip("[]").strip()
    others = _matches(lines, header + 1, rf"\s*\[+\s*(?!{re.escape(name)}\.)[\w.]+\s*\]")
    return others[0] if others else len(lines)


def _matches(lines: list[str], start: int, pattern: str) -> list[int]:
    """Return the numbers (from 0) of the lines from `start` on whose beginning matches, without their comments.

    pattern: regular expression
    """
    return [n for n in range(start, len(lines)) if re.match(pattern, lines[n].split("#")[0])]


def dotted(raw: object, key: Key) -> str:
    """Return a key as a dotted path, with the names of an array's tables instead of their numbers.

    A table without a name is "#1", "#2", ...; the number of a value in a list is omitted; no key is "the file".

    raw: content of the file as parsed from TOML
    """
    parts: list[str] = []
    for part in key:
        raw = _entry(raw, part)
        if isinstance(part, str):
            parts.append(part)
        elif isinstance(raw, dict) and raw.get("name"):
            parts.append(shown(raw["name"]).strip("'"))
        elif isinstance(raw, dict) or raw is None:
            parts.append(f"#{part + 1}")
    return ".".join(parts) or "the file"


def _entry(raw: object, part: str | int) -> object:
    """Return one value of a table or array; None where there is none."""
    if isinstance(raw, dict):
        return raw.get(part)
    if isinstance(raw, list) and isinstance(part, int) and part < len(raw):
        return raw[part]
    return None


def written_key(raw: object, key: Key) -> Key:
    """Return the key as the file has it: `range` is written as `range_bar`, `range_deg`, ...

    The key is returned unchanged where its table has it, or no single key of that beginning.

    raw: content of the file as parsed from TOML
    """
    table = value_at(raw, key[:-1])
    if not key or not isinstance(table, dict) or key[-1] in table:
        return key
    named = [name for name in table if name.startswith(f"{key[-1]}_")]
    return (*key[:-1], named[0]) if len(named) == 1 else key


def value_at(raw: object, key: Key) -> object:
    """Return the value at a key; None where there is none."""
    for part in key:
        raw = _entry(raw, part)
    return raw


def unit_of(key: Key) -> str:
    """Return the unit of a key whose name ends in one, as the end of a sentence ("; it is in mm"), else ""."""
    name = next((part for part in reversed(key) if isinstance(part, str)), "")
    unit = next((word for suffix, word in UNITS.items() if name.endswith(f"_{suffix}")), None)
    return f"; it is in {unit}" if unit else ""


def shown(value: object) -> str:
    """Return a value of the file for a message, as Python prints it, cut to 40 characters."""
    try:
        text = repr(value)
    except ValueError:  # an integer of more digits than Python prints
        return "a number of thousands of digits"
    return text if len(text) <= 40 else text[:37] + "..."
