"""Write a proposed machine as the text of a machine file.

It is the example's text with other values. Comments name the source of each value and those that must be measured.
"""

from collections.abc import Iterator, Mapping
from typing import Any

import tomlkit
from tomlkit.items import AoT, InlineTable, Item, Table

from cylforce.settings.proposal.scaling import ProposedMachine
from cylforce.settings.proposal.types import ENVELOPE, MachineType, Raw

MEASURE = "MEASURE THIS"  # marks what no data sheet gives
HEAD = """\
# {title} of {tonnes:g} t, proposed by `cylforce new` from its data sheet.
#
# Figures marked "data sheet" were given. Figures marked "typical" are those of a machine of this size: replace them.
# Pins marked "{measure}" are the nearest to typical ones with which each cylinder's stroke covers its joint's angle
# range. The tolerances are as large as such guesses are wrong: until the pins are measured (then set pins_m, for
# example to 0.002) or a known weight was lifted (cylforce identify --lift), heavy loads are not booked.
# `cylforce describe FILE --svg arm.svg` draws every pin.
"""
PINS = ("foot", "eye", "rocker_pin", "link_pin", "inner_pin", "outer_pin")


def text(kind: MachineType, example: str, proposed: ProposedMachine, tonnes: float, given: frozenset[str]) -> str:
    """Return the text of the file.

    example: text of the type's example
    proposed: the proposed machine
    tonnes: operating mass [t]
    given: keys of `figures` that came from the data sheet
    """
    document = tomlkit.parse(example[example.index("\n#\n") + 1 :])  # without the example's own introduction
    _update(document, proposed.tables)
    for key, words in _comments(proposed, given):
        _comment(document, key, words)
    head = HEAD.format(title=kind.title, tonnes=tonnes, measure=MEASURE)
    return head + document.as_string()


def _update(document: Any, tables: Mapping[str, Any]) -> None:  # noqa: ANN401 - any table of tomlkit
    """Write the values of `tables` over those of a document; a value that changes loses its comment.

    Keys of the document that `tables` lacks are removed.
    """
    for key in [key for key in document if key not in tables]:
        del document[key]
    for key, value in tables.items():
        old = document.get(key)
        if isinstance(old, Table) or (
            isinstance(value, Mapping) and old is not None and not isinstance(old, InlineTable)
        ):
            _update(old, value)
        elif isinstance(old, AoT):
            for part, new in zip(old, value, strict=True):
                _update(part, new)
        elif old != value:
            document[key] = _item(value)


def _item(value: object) -> Item:
    """Return a value for TOML: numbers as short as they can be, tables in one line."""
    if isinstance(value, Mapping):
        inline = tomlkit.inline_table()
        inline.update({key: _item(part) for key, part in value.items()})
        return inline
    if isinstance(value, list | tuple):
        array = tomlkit.array()
        array.extend([_item(part) for part in value])
        return array
    return tomlkit.item(int(value) if isinstance(value, float) and value.is_integer() else value)


def _comments(proposed: ProposedMachine, given: frozenset[str]) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Yield the keys of the file that get a comment, and the comment.

    A key is a path, for example ("links", 0, "mass_kg").

    proposed: the machine
    given:    keys of `figures` that came from the data sheet, for example "boom.mass_kg"
    """
    tables = proposed.tables
    yield ("machine", "rated_payload_kg"), _source("rated_payload_kg" in given, "data sheet, load chart")
    if "payload_reach_m" in tables["machine"]:
        words = "from the last pin to the middle of the material, at most"
        yield ("machine", "payload_reach_m"), f"{words}: typical; {MEASURE}"
    if "slew_axis_m" in tables["machine"]:
        yield ("machine", "slew_axis_m"), f"the boom pin lies so far before the slew axis: typical; {MEASURE}"
    for k, link in enumerate(tables["links"]):
        yield from _of_link(k, link, proposed, given)
    last = tables["links"][-1]["name"]
    yield ("tool", "point_m"), f"the line of the teeth; {_source(f'{last}.length_m' in given, MEASURE)}"
    for k, cylinder in enumerate(tables["cylinders"]):
        yield from _of_cylinder(k, cylinder, given)


def _of_link(
    k: int, link: Raw, proposed: ProposedMachine, given: frozenset[str]
) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Yield keys of link k and their comments, as `_comments`.

    link:     table of the link
    proposed: the machine, with the angle ranges that were narrowed
    given:    keys of `figures` that came from the data sheet, for example "boom.mass_kg"
    """
    name = link["name"]
    if "length_m" in link:
        yield ("links", k, "length_m"), _source(f"{name}.length_m" in given, f"{MEASURE}, from pin to pin")
    yield ("links", k, "mass_kg"), _source(f"{name}.mass_kg" in given, "weigh it or ask the maker")
    yield ("links", k, "centre_m"), "typical, scaled: identify corrects it"
    yield ("links", k, "inertia_kg_m2"), "typical, scaled: identify corrects it"
    if k == 0 and given & set(ENVELOPE):
        yield ("links", k, "angle_range_deg"), "from the working envelope of the data sheet"
    elif f"{name}.angle_range_deg" in proposed.narrowed:
        words = "typical, narrowed to what its cylinder can cover"
        yield ("links", k, "angle_range_deg"), f"{words}; {MEASURE}, at both end stops"
    else:
        known = f"{name}.angle_range_deg" in given
        yield ("links", k, "angle_range_deg"), _source(known, f"{MEASURE}, at both end stops")


def _of_cylinder(k: int, cylinder: Raw, given: frozenset[str]) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Yield keys of cylinder k and their comments, as `_comments`.

    cylinder: table of the cylinder
    given:    keys of `figures` that came from the data sheet, for example "boom.bore_mm"
    """
    name = cylinder["name"]
    for key in ("count", "bore_mm", "rod_mm"):
        if key in cylinder:
            yield ("cylinders", k, key), _source(f"{name}.{key}" in given, f"{MEASURE} or see the parts list")
    known = [f"{name}.{key}" in given for key in ("stroke_mm", "closed_mm")]
    words = (
        f"the {'stroke' if known[0] else 'closed length'} from the data sheet; {MEASURE}"
        if any(known)
        else f"typical; {MEASURE}"
    )
    yield ("cylinders", k, "length_range_m"), "data sheet" if all(known) else f"{words}, pin to pin, closed and open"
    for key in PINS:
        if key in cylinder["linkage"]:
            yield ("cylinders", k, "linkage", key), MEASURE
    for key in ("rocker_m", "link_m"):
        if key in cylinder["linkage"]:
            yield ("cylinders", k, "linkage", key), f"{MEASURE}, from pin to pin"
    if "eye_m" in cylinder["linkage"]:
        yield ("cylinders", k, "linkage", "eye_m"), f"{MEASURE}: x from rocker pin to rocker end, z to its left"


def _source(is_given: bool, cure: str) -> str:
    """Return the source of a value, and for a typical one the cure."""
    return "data sheet" if is_given else f"typical; {cure}"


def _comment(document: Any, key: tuple[str | int, ...], words: str) -> None:  # noqa: ANN401 - any table of tomlkit
    """Write a comment beside a key.

    key: path of the key, for example ("links", 0, "mass_kg")
    """
    *path, last = key
    table = document
    for part in path:
        table = table[part]
    table.item(last).comment(words)
