"""What is wrong with a machine file, said in one sentence: file, line, key, cure."""

import re
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path

from pydantic_core import ErrorDetails

from cylforce.settings.units import shown

Key = tuple[str | int, ...]
TAGS = (
    "triangle",
    "four_bar",
    "dogbone",
)  # pydantic puts the kind of a linkage into the key; the file has none there


class SettingsError(ValueError):
    """A machine file that cannot be used; its text is one sentence that names file, line, key and cure."""


class FaultError(ValueError):
    """A fault at a key; `load` adds the file and the line."""

    def __init__(self, key: Sequence[str | int], problem: str) -> None:
        super().__init__(problem)
        self.key = tuple(key)


def sentence(path: Path, text: str, raw: object, key: Key, problem: str) -> str:
    """The whole message."""
    found = tuple(part for part in key if part not in TAGS)
    return f"{path}:{line_of(text, found)}: {dotted(raw, found)} {problem}"


def line_of(text: str, key: Key) -> int:
    """Line (from 1) of a key, or of the nearest table around it that can be found without parsing."""
    lines, at = text.splitlines(), 0
    for k, part in enumerate(key):
        if isinstance(part, int):
            continue
        after = key[k + 1] if k + 1 < len(key) else 0
        header = rf"\s*\[+\s*([\w.]+\.)?{re.escape(part)}\s*\]"
        hits = _matches(lines, at, header)
        if isinstance(after, int) and after < len(hits):
            at = hits[after]  # the n-th of several tables; else the n-th of an array's values, which is on its line
            continue
        hits = hits or _matches(lines, at, rf"(.*[\s{{,.])?{re.escape(part)}\s*[.=]")
        if not hits:
            break
        at = hits[0]
    return at + 1


def _matches(lines: list[str], start: int, pattern: str) -> list[int]:
    return [n for n in range(start, len(lines)) if re.match(pattern, lines[n].split("#")[0])]


def dotted(raw: object, key: Key) -> str:
    """The key as a dotted path, with the names of table entries in place of their numbers."""
    parts: list[str] = []
    for part in key:
        entry = _entry(raw, part)
        name = entry.get("name") if isinstance(part, int) and isinstance(entry, dict) else None
        parts.append(str(name) if name else f"#{part + 1}" if isinstance(part, int) else part)
        raw = entry
    return ".".join(parts) or "the file"


def _entry(raw: object, part: str | int) -> object:
    if isinstance(raw, dict):
        return raw.get(part)
    if isinstance(raw, list) and isinstance(part, int) and part < len(raw):
        return raw[part]
    return None


def fault(error: ErrorDetails, known: Sequence[str]) -> FaultError:
    """A finding of pydantic as a fault with its cure."""
    key, kind = error["loc"], error["type"]
    if kind == "missing":
        return FaultError(key[:-1], f"lacks the key {key[-1]}: add it")
    if kind == "extra_forbidden":
        close = get_close_matches(str(key[-1]), known, 1)
        return FaultError(key, f"is not a key of this table: {f'did you mean {close[0]}' if close else 'remove it'}")
    if kind == "value_error":
        return FaultError(key, str(error["msg"]).removeprefix("Value error, "))
    problem = str(error["msg"]).replace("Input should be", "must be").replace("Input should have", "must have")
    return FaultError(key, f"{problem[:1].lower()}{problem[1:]}, not {shown(error['input'])}: correct the value")
