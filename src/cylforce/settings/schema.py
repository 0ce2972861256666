"""JSON schema of the machine file: for editors that complete and check TOML, and for the table of keys in
config/README.md.
"""

from typing import Any

from cylforce.settings.model import MachineFile, SignalColumn
from cylforce.settings.units import COLUMN, SUFFIXES, WORDS
from cylforce.signals.kinds import UNIT

Schema = dict[str, Any]
DIALECT = "https://json-schema.org/draft/2020-12/schema"


def machine_file_schema() -> Schema:
    """Return the schema (draft 2020-12), made from the models that check a file.

    Checks that need several tables at once (names, references, geometry) are not in it.
    """
    schema = MachineFile.model_json_schema(mode="validation")
    tables: dict[str, Schema] = schema["$defs"]
    tables["SignalColumn"] = SignalColumn.model_json_schema()
    _write_units(tables["SensorTable"], WORDS, sorted(set(UNIT.values())))
    _write_units(tables["TimeColumn"], ("scale",), ["s"])
    _write_units(tables["SignalColumn"], COLUMN, sorted(set(UNIT.values())))
    tables["SensorTable"]["allOf"] = [_units_of_kind(kind, unit) for kind, unit in UNIT.items()]
    tables["RecordingTable"]["properties"]["signals"]["additionalProperties"] = {"$ref": "#/$defs/SignalColumn"}
    return {"$schema": DIALECT, **schema}


def _write_units(table: Schema, words: tuple[str, ...], units: list[str]) -> None:
    """Replace keys in a table's schema by those that the file has: `range_bar`, `range_deg`, ... for `range`.

    A replaced key is no longer required, because only one of its units is given.

    table: schema of a table, with its `properties`
    words: keys that are written with a unit, such as `range`
    units: SI units of the quantities that these keys may have, such as Pa and rad
    """
    properties: dict[str, Schema] = {}
    for name, of_key in table["properties"].items():
        if name in words:
            properties |= {f"{name}_{suffix}": _with_unit(of_key, suffix) for suffix in _suffixes(units)}
        else:
            properties[name] = of_key
    table["properties"] = properties
    table["required"] = [name for name in table.get("required", []) if name not in words]


def _with_unit(of_key: Schema, suffix: str) -> Schema:
    """Return the schema of a key with a unit.

    A default value is omitted, because it is in SI; null is kept.

    of_key: schema of the key without its unit
    suffix: unit in the file, such as bar or deg
    """
    default = {"default": of_key["default"]} if of_key.get("default") is None and "default" in of_key else {}
    return {**{k: v for k, v in of_key.items() if k not in ("default", "title")}, **default, "title": f"in {suffix}"}


def _suffixes(units: list[str]) -> list[str]:
    """Return the suffixes of the keys of quantities with these SI units: bar, mpa, kpa, pa for Pa."""
    return [suffix for unit in units for suffix in SUFFIXES[unit]]


def _units_of_kind(kind: str, unit: str) -> Schema:
    """Return the schema rule that a sensor of this kind has a range, and no key in the unit of another quantity.

    kind: kind of the sensor
    unit: SI unit of its signal
    """
    others = [suffix for suffix in _suffixes(list(SUFFIXES)) if suffix not in SUFFIXES[unit]]
    foreign = {f"{word}_{suffix}": False for word in WORDS for suffix in others}
    ranges = [{"required": [f"range_{suffix}"]} for suffix in SUFFIXES[unit]]
    return {
        "if": {"properties": {"kind": {"const": str(kind)}}, "required": ["kind"]},
        "then": {"properties": foreign, "anyOf": ranges},
    }
