"""Writes the table of a machine file's keys into config/README.md, between two markers, from the JSON schema that is
made from the models. With --check it writes nothing; exit code 1 when the page is out of date."""

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from cylforce.settings.schema import machine_file_schema

PAGE = Path(__file__).resolve().parents[1] / "config" / "README.md"
BEGIN, END = "<!-- keys: written by tools/machine_file_keys -->", "<!-- end of keys -->"
LEAST = {"minimum": "{} or more", "exclusiveMinimum": "more than {}"}
MOST = {"maximum": "{} or less", "exclusiveMaximum": "less than {}"}
NO_LIMIT = 1e11  # what lies beyond is there against overflow
UNITS = (
    *("m_s2", "g", "deg_s", "rad_s", "deg", "rad", "mm", "m", "us", "ms", "s"),
    *("mpa", "kpa", "bar", "pa", "kn", "n", "degc", "k"),
)
Schema = dict[str, Any]


def keys_table() -> str:
    """The table in Markdown: a line for each section, then its keys, nested ones dotted."""
    schema = machine_file_schema()
    lines = ["| key | meaning | values (typical) | default |", "|---|---|---|---|"]
    for name, of_key in schema["properties"].items():
        header = f"[[{name}]]" if of_key.get("type") == "array" else f"[{name}]"
        (table,) = _tables(of_key, schema)
        meaning = of_key.get("description") or table["description"]
        lines.append(f"| **`{header}`** | **{meaning}** | | {_default(of_key, name, schema)} |")
        lines.extend(row for row in _rows(table, "", schema) if not _repeats(row, lines))
        if name == "cylinders":
            lines.extend(_rows(schema["$defs"]["Pin"], "linkage.PIN.", schema))
    return "\n".join(lines)


def _repeats(row: str, lines: list[str]) -> bool:
    """Whether it is a key of an inner table that another section has with the same words."""
    return "." in row.partition("` |")[0] and row in lines


def _rows(table: Schema, prefix: str, schema: Schema) -> Iterator[str]:
    """The keys of a table; a key that holds a table again is followed by that table's keys, but not at each pin."""
    for name, of_key in _without_variants(table["properties"]).items():
        inner = _tables(of_key, schema)
        values = f"{{ {', '.join(inner[0]['properties'])} }}" if inner else _values(of_key, schema)
        values = " or ".join(one["properties"]["kind"]["const"] for one in inner) if len(inner) > 1 else values
        meaning = of_key.get("description") or inner[0]["description"]
        yield f"| `{prefix}{name}` | {meaning} | {values} | {_default(of_key, name, table)} |"
        is_pin = of_key.get("$ref", "").endswith("/Pin")  # pins are all alike
        for one in () if is_pin else inner:
            yield from _rows(one, f"{prefix}{name}.", schema)


def _without_variants(properties: Schema) -> Schema:
    """`scale_bar`, `scale_deg`, ... as one row `scale_UNIT`."""
    found: Schema = {}
    for name, of_key in properties.items():
        unit = next((u for u in UNITS if name.endswith(f"_{u}")), None)
        word = name.removesuffix(f"_{unit}") if unit else ""
        variants = [other for other in properties if other.startswith(f"{word}_") and other != name]
        found[f"{word}_UNIT" if word in ("scale", "offset", "range", "standard_error") and variants else name] = of_key
    return found


def _tables(of_key: Schema, schema: Schema) -> list[Schema]:
    """The tables that a key may hold."""
    if "$ref" in of_key:
        found = schema["$defs"][of_key["$ref"].removeprefix("#/$defs/")]
        return [found] if "properties" in found else []
    inner = [*of_key.get("oneOf", ()), *of_key.get("anyOf", ())]
    inner += [of_key[k] for k in ("items", "additionalProperties") if isinstance(of_key.get(k), dict)]
    return [table for one in inner for table in _tables(one, schema)]


def _values(of_key: Schema, schema: Schema) -> str:
    if "$ref" in of_key:
        of_key = schema["$defs"][of_key["$ref"].removeprefix("#/$defs/")]
    if "anyOf" in of_key:
        return _values(next(one for one in of_key["anyOf"] if one.get("type") != "null"), schema)
    if "prefixItems" in of_key:
        return f"two numbers, each {limits}" if (limits := _limits(of_key["prefixItems"][0])) else "two numbers"
    if "const" in of_key or "enum" in of_key:
        return ", ".join(f"`{value}`" for value in of_key.get("enum", [of_key.get("const")]))
    words = {"boolean": "`true`, `false`", "string": "text", "array": "list"}
    return words.get(of_key.get("type", ""), "") or _limits(of_key) or "any number"


def _limits(of_number: Schema) -> str:
    least = [text.format(_number(of_number[k])) for k, text in LEAST.items() if abs(of_number.get(k, 1e12)) < NO_LIMIT]
    most = [text.format(_number(of_number[k])) for k, text in MOST.items() if abs(of_number.get(k, 1e12)) < NO_LIMIT]
    if "minimum" in of_number and "maximum" in of_number and least and most:
        least, most = [f"{_number(of_number['minimum'])} to {_number(of_number['maximum'])}"], []
    typical = of_number.get("x-typical")
    said = f" ({_number(typical[0])} to {_number(typical[1])})" if typical else ""
    return ", ".join(least + most) + said


def _number(value: float) -> str:
    return f"{value:,.12g}".replace(",", " ") if abs(value) >= 10_000 else f"{value:.12g}"


def _default(of_key: Schema, name: str, table: Schema) -> str:
    if "default" not in of_key:
        return "required" if name in table.get("required", []) or name == "range_UNIT" else ""
    default = of_key["default"]
    if default is None or isinstance(default, dict) or default == []:
        return ""
    if isinstance(default, bool):
        return str(default).lower()
    if isinstance(default, list):
        return ", ".join(map(str, default))
    return _number(default) if isinstance(default, int | float) else str(default)


def page(text: str) -> str:
    """The page with its table of keys made anew."""
    before, _, rest = text.partition(BEGIN)
    _, found, after = rest.partition(END)
    if not found:
        raise ValueError(f"config/README.md lacks the markers {BEGIN} and {END}: put them around its table of keys")
    return f"{before}{BEGIN}\n{keys_table()}\n{END}{after}"


def main() -> int:
    """Write the page; 1 with a sentence where it cannot be, or is out of date."""
    parser = argparse.ArgumentParser(prog="machine_file_keys", description=__doc__)
    parser.add_argument("--check", action="store_true", help="write nothing; exit code 1 when the page is out of date")
    options = parser.parse_args()
    try:
        old = PAGE.read_text(encoding="utf-8")
        new = page(old)
    except (OSError, ValueError) as error:
        print(f"machine_file_keys: {error}", file=sys.stderr)
        return 2
    if options.check:
        return int(new != old)
    PAGE.write_text(new, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
