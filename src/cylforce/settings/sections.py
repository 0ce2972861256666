"""Reads the sections of a machine file ([machine], [[links]], ...) each on its own, so that an error in one does not
hide those in another, and says in ordinary words what pydantic finds."""

import re
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from typing import Annotated, Any, get_args

from pydantic import BaseModel, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from cylforce.settings.error import TAGS, FaultError, Inspection, Key, shown, unit_of, value_at, written_key
from cylforce.settings.model import MachineFile
from cylforce.settings.units import SUFFIXES, WORDS

# words of pydantic -> words for a reader who knows TOML but not Python
WORDING = {
    "Input should be": "must be",
    "Input should have": "must have",
    "Tuple should have": "must have",
    " after validation": "",
    r" items?, not \d+": " entries",
    "a valid integer": "a whole number",
    "a valid ": "a ",
    "String should match pattern .*": "must be a letter, then letters, digits and _, at most 40 in all",
    "String should have at least 1 character": "must not be empty",
    "boolean": "truth value (true or false)",
}
_SECTIONS: dict[str, TypeAdapter[Any]] = {
    name: TypeAdapter(Annotated[info.annotation, info])  # type: ignore[arg-type] # a type that is built at run time
    for name, info in MachineFile.model_fields.items()
}


def read_sections(
    raw: Mapping[str, object], written: Mapping[str, object], findings: Inspection
) -> tuple[MachineFile, frozenset[str]]:
    """The file with those sections that are right, and their names. `raw` is in SI, `written` as the file has it; every
    error goes to `findings`."""
    good: dict[str, Any] = {}
    for name, info in MachineFile.model_fields.items():
        if name in raw:
            try:
                good[name] = _SECTIONS[name].validate_python(raw[name])
            except ValidationError as error:
                findings.errors.extend(_faults(error, name, written))
        elif info.is_required():
            findings.errors.append(lacking((), name))
        else:
            good[name] = info.get_default(call_default_factory=True)
    findings.errors.extend(_unknown((name,), MachineFile) for name in raw if name not in MachineFile.model_fields)
    return MachineFile.model_construct(**good), frozenset(good)


def _faults(error: ValidationError, name: str, written: Mapping[str, object]) -> Iterable[FaultError]:
    for found in error.errors():
        if found["type"] == "too_short" and len(found["input"]) >= found["ctx"]["min_length"]:
            continue  # pydantic counts good entries only; the others' errors are found too
        key = tuple(part for part in (name, *found["loc"]) if part not in TAGS)
        here = written_key(written, key) if found["type"] != "missing" else key
        if here != key:  # say the value in the unit of the file
            found["input"] = value_at(written, here)
        yield fault(found, here)


def lacking(key: Key, name: str) -> FaultError:
    """The fault of a table that lacks a key."""
    return FaultError(key, f"lacks the key {name}: add it", (name,))


def fault(error: ErrorDetails, key: Key, table: type[BaseModel] | None = None) -> FaultError:
    """A finding of pydantic as a fault with its cure; `table`: that of the key, where the key does not say it."""
    kind = error["type"]
    if kind == "missing":
        return _missing(key)
    if kind == "extra_forbidden":
        return _unknown(key, table or table_of(key[:-1]))
    if kind.startswith("union_tag"):
        return _other_kind(error, key)
    if kind == "value_error":
        return FaultError(key, str(error["msg"]).removeprefix("Value error, "))
    return _wrong_value(error, key)


def _missing(key: Key) -> FaultError:
    last = key[-1]
    if isinstance(last, int):
        return FaultError(key[:-1], f"must have at least {last + 1} entries: add what is missing")
    return lacking(key[:-1], last)


def _wrong_value(error: ErrorDetails, key: Key) -> FaultError:
    kind, given, problem = error["type"], shown(error["input"]), str(error["msg"])
    if kind in ("model_type", "dict_type"):
        return FaultError(key, f"must be a table of keys, not {given}: write {_header(key)}")
    if kind == "tuple_type":
        return FaultError(key, f"must be a list, not {given}: write {_header(key, '[[', ']]')}")
    for said, words in WORDING.items():
        problem = re.sub(said, words, problem)
    return FaultError(key, f"{problem[:1].lower()}{problem[1:]}, not {given}: correct the value{unit_of(key)}")


def _other_kind(error: ErrorDetails, key: Key) -> FaultError:
    """A linkage whose kind is missing or unknown."""
    kinds = ", ".join(TAGS)
    if error["type"] == "union_tag_not_found":
        return FaultError(key, f"lacks the key kind: write one of {kinds}", ("kind",))
    return FaultError((*key, "kind"), f"is {shown(error['input'].get('kind'))}: write one of {kinds}")


def _header(key: Key, opening: str = "[", closing: str = "]") -> str:
    if len(key) == 1:
        return f"{opening}{key[0]}{closing} and its keys below it"
    return "[..., ...]" if opening == "[[" else "{ key = value, ... }"


def _unknown(key: Key, table: type[BaseModel] | None) -> FaultError:
    name, own = str(key[-1]), known_keys([table] if table else [])
    close = get_close_matches(name, own, 1) or get_close_matches(name, known_keys(_tables()), 1, 0.75)
    cure = (
        f"did you mean {close[0]}?" if close else f"remove it; the table has {', '.join(own)}" if own else "remove it"
    )
    where = "this table" if len(key) > 1 else "a machine file"
    return FaultError(key, f"is not a key of {where}: {cure}", unknown=True)


def table_of(key: Key) -> type[BaseModel] | None:
    """The model of the table at a key; None where a key may hold one of several tables."""
    found: tuple[type[BaseModel], ...] = (MachineFile,)
    for part in key:
        if isinstance(part, str) and len(found) == 1:
            info = found[0].model_fields.get(part)
            found = tuple(_models(info.annotation)) if info else ()
    return found[0] if len(found) == 1 else None


def _models(hint: object) -> Iterable[type[BaseModel]]:
    if isinstance(hint, type) and issubclass(hint, BaseModel):
        yield hint
    for part in get_args(hint):
        yield from _models(part)


def _tables() -> list[type[BaseModel]]:
    """All tables that a machine file can have."""
    found: list[type[BaseModel]] = [MachineFile]
    for table in found:
        for info in table.model_fields.values():
            found.extend(inner for inner in _models(info.annotation) if inner not in found)
    return found


def known_keys(tables: Iterable[type[BaseModel]]) -> list[str]:
    """The keys of tables as they are written, units included: to guess what a misspelt one meant."""
    names = {key for table in tables for key in table.model_fields}
    suffixes = {suffix for table in SUFFIXES.values() for suffix in table}
    united = {f"{word}_{suffix}" for word in WORDS if word in names for suffix in suffixes}
    return sorted(names - set(WORDS) | united)
