"""Read the sections of a machine file ([machine], [[links]], ...) and express pydantic's findings in ordinary words.

Each section is read on its own, so that an error in one does not hide those in another.
"""

import re
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from typing import Annotated, Any, get_args

from pydantic import BaseModel, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from cylforce.settings.error import TAGS, FaultError, Inspection, Key, shown, unit_of, value_at, written_key
from cylforce.settings.model import MachineFile
from cylforce.settings.units import SUFFIXES, WORDS

# Words of pydantic, and words for a reader who knows TOML but not Python.
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
    """Return the file with its valid sections, and their names; every error goes to `findings`.

    An optional section that is not in the file has its default, and is valid. Only valid sections may be read.

    raw: the file with SI values, as of `file_in_si`
    written: the file as it is, with the keys and values that messages show
    """
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
    """Yield the faults of a section."""
    for detail in error.errors():
        if detail["type"] == "too_short" and len(detail["input"]) >= detail["ctx"]["min_length"]:
            continue  # pydantic counts good entries only; the errors of the others are reported, too
        key = tuple(part for part in (name, *detail["loc"]) if part not in TAGS)
        in_file = written_key(written, key) if detail["type"] != "missing" else key
        if in_file != key:  # show the value in the unit of the file
            detail["input"] = value_at(written, in_file)
        yield fault(detail, in_file)


def lacking(key: Key, name: str) -> FaultError:
    """Return the fault of a table that lacks a key.

    key: key of the table
    name: the key that it lacks
    """
    return FaultError(key, f"lacks the key {name}: add it", (name,))


def fault(error: ErrorDetails, key: Key, table: type[BaseModel] | None = None) -> FaultError:
    """Return a finding of pydantic as a fault with its cure.

    table: the table of the key, where the key alone does not determine it
    """
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
    """Return the fault of a missing key or entry."""
    last = key[-1]
    if isinstance(last, int):
        return FaultError(key[:-1], f"must have at least {last + 1} entries: add what is missing")
    return lacking(key[:-1], last)


def _wrong_value(error: ErrorDetails, key: Key) -> FaultError:
    """Return the fault of a value of the wrong type or beyond a limit."""
    kind, given, problem = error["type"], shown(error["input"]), str(error["msg"])
    if kind in ("model_type", "dict_type"):
        return FaultError(key, f"must be a table of keys, not {given}: write {_header(key)}")
    if kind == "tuple_type":
        return FaultError(key, f"must be a list, not {given}: write {_header(key, '[[', ']]')}")
    for pattern, words in WORDING.items():
        problem = re.sub(pattern, words, problem)
    return FaultError(key, f"{problem[:1].lower()}{problem[1:]}, not {given}: correct the value{unit_of(key)}")


def _other_kind(error: ErrorDetails, key: Key) -> FaultError:
    """Return the fault of a linkage whose kind is missing or unknown."""
    kinds = ", ".join(TAGS)
    if error["type"] == "union_tag_not_found":
        return FaultError(key, f"lacks the key kind: write one of {kinds}", ("kind",))
    return FaultError((*key, "kind"), f"is {shown(error['input'].get('kind'))}: write one of {kinds}")


def _header(key: Key, opening: str = "[", closing: str = "]") -> str:
    """Return how a table or array at a key is written in TOML: with a header at the top level, else in one line."""
    if len(key) == 1:
        return f"{opening}{key[0]}{closing} and its keys below it"
    return "[..., ...]" if opening == "[[" else "{ key = value, ... }"


def _unknown(key: Key, table: type[BaseModel] | None) -> FaultError:
    """Return the fault of an unknown key, with the key that was probably meant."""
    name, keys = str(key[-1]), known_keys([table] if table else [])
    close = get_close_matches(name, keys, 1) or get_close_matches(name, known_keys(_tables()), 1, 0.75)
    if close:
        cure = f"did you mean {close[0]}?"
    else:
        cure = f"remove it; the table has {', '.join(keys)}" if keys else "remove it"
    where = "this table" if len(key) > 1 else "a machine file"
    return FaultError(key, f"is not a key of {where}: {cure}", unknown=True)


def table_of(key: Key) -> type[BaseModel] | None:
    """Return the model of the table at a key; None where it has none, or one of several (as a linkage has)."""
    models: tuple[type[BaseModel], ...] = (MachineFile,)
    for part in key:
        if isinstance(part, str) and len(models) == 1:
            info = models[0].model_fields.get(part)
            models = tuple(_models(info.annotation)) if info else ()
    return models[0] if len(models) == 1 else None


def _models(hint: object) -> Iterable[type[BaseModel]]:
    """Yield the models in a type hint."""
    if isinstance(hint, type) and issubclass(hint, BaseModel):
        yield hint
    for part in get_args(hint):
        yield from _models(part)


def _tables() -> list[type[BaseModel]]:
    """Return all tables that a machine file can have."""
    tables: list[type[BaseModel]] = [MachineFile]
    for table in tables:  # grows while it is read
        for info in table.model_fields.values():
            tables.extend(inner for inner in _models(info.annotation) if inner not in tables)
    return tables


def known_keys(tables: Iterable[type[BaseModel]]) -> list[str]:
    """Return the keys of tables as they are written, units included, as candidates for a misspelt one."""
    names = {key for table in tables for key in table.model_fields}
    suffixes = {suffix for table in SUFFIXES.values() for suffix in table}
    united = {f"{word}_{suffix}" for word in WORDS if word in names for suffix in suffixes}
    return sorted(names - set(WORDS) | united)
