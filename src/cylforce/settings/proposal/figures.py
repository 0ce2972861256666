"""Figures of a data sheet for `cylforce new`: their keys, typical values and limits."""

from collections.abc import Iterable, Iterator, Mapping
from difflib import get_close_matches
from typing import NamedTuple

from cylforce.settings.proposal.types import MachineType, Range, Raw, size

Value = str | int | float | Range | None  # None: follows from the others
LENGTH = (0.4, 2.5)  # limits of a length, times the typical one: proportions within one type; chosen
MASS = (0.2, 4.0)  # limits of a mass, times the typical one: quick couplers, long-reach booms, heavy tools; chosen
BORE = (0.5, 2.0)  # limits of a bore, times the typical one; chosen
PINS_MM = 20.0  # mm, half-width of the error of pins that were fitted to the cylinders of a 20 t machine; chosen


class Figure(NamedTuple):
    """One figure of a data sheet.

    key: key as in the machine file, if the file has it
    words: its meaning, with its unit
    typical: typical value; None: it follows from other figures
    low: lower limit of the value, or of both ends of a range
    high: upper limit of the value, or of both ends of a range
    shape: str, int, float, or tuple for a range
    """

    key: str
    words: str
    typical: Value
    low: float = 0.0
    high: float = 0.0
    shape: type = float  # str, int, float or tuple


def figures(kind: MachineType, raw: Raw, tonnes: float) -> tuple[Figure, ...]:
    """Return the figures that a data sheet of a machine of this type and mass may give, each with its typical value.

    Typical lengths grow with the cube root of the operating mass, masses in proportion to it.

    raw: tables of the type's example
    tonnes: operating mass [t]
    """
    s = size(kind, tonnes)
    share = tonnes / kind.tonnes
    payload = _rounded(raw["machine"]["rated_payload_kg"] * share)
    return (
        Figure("name", "name of the machine", f"{kind.title} {tonnes:g} t", shape=str),
        Figure("rated_payload_kg", "rated payload [kg]", payload, *_around(payload, MASS)),
        *(figure for link in range(len(raw["links"])) for figure in _of_link(raw, link, s, share)),
        *_of_envelope(kind, s),
        *(figure for cylinder in raw["cylinders"] for figure in _of_cylinder(cylinder, s)),
        Figure("pins_mm", "half-width within which the pins are right [mm]", _rounded(PINS_MM * s), 0.1, 100.0),
        *(
            Figure(f"{node['name']}.node_id", f"{node['name']}: CANopen node id", node["node_id"], 1, 127, int)
            for node in raw["nodes"]
        ),
    )


def _of_link(raw: Raw, k: int, s: float, share: float) -> Iterator[Figure]:
    """Yield the figures of link k; `s`, `share`: size and mass, times the example's."""
    link, name = raw["links"][k], raw["links"][k]["name"]
    last = k == len(raw["links"]) - 1
    length = _rounded(s * (raw["tool"]["point_m"][0] if last else link["length_m"]))
    ends = "from its pin to the teeth" if last else "from pin to pin"
    yield Figure(f"{name}.length_m", f"{name}: length {ends} [m]", length, *_around(length, LENGTH))
    mass = _rounded(link["mass_kg"] * share)
    yield Figure(f"{name}.mass_kg", f"{name}: mass with its share of cylinders [kg]", mass, *_around(mass, MASS))
    typical = drive_range(raw, k)
    words = f"{name}: angle range, {_from(raw, k)} [deg]"
    yield Figure(f"{name}.angle_range_deg", words, typical, typical[0] - 60.0, typical[1] + 60.0, tuple)


def _from(raw: Raw, k: int) -> str:
    """Return from where the angle of link k is measured."""
    if reached_over(raw, k):
        return "from the horizontal with the chassis level"
    return "from the horizontal" if k == 0 else f"from the {raw['links'][k - 1]['name']}'s line"


def reached_over(raw: Raw, k: int) -> tuple[int, ...]:
    """Return the joints before joint k that its cylinder reaches over (a wheel loader's tilt cylinder); () for others.

    raw: tables of a machine file
    """
    bodies = ["chassis", *(link["name"] for link in raw["links"])]
    for cylinder in raw["cylinders"]:
        pins = [bodies.index(p["body"]) for p in cylinder["linkage"].values() if isinstance(p, Mapping)]
        if max(pins) == k + 1:
            return tuple(range(min(pins), k))
    return ()


def drive_range(raw: Raw, k: int) -> Range:
    """Return the range [deg] of the angle that the cylinder at joint k sets: of its joint, or from the chassis.

    From the chassis it is the range that remains at every angle of the joints that the cylinder reaches over.
    """
    low, high = raw["links"][k]["angle_range_deg"]
    others = [raw["links"][i]["angle_range_deg"] for i in reached_over(raw, k)]
    return (
        float(low + sum(other_high for other_low, other_high in others)),
        float(high + sum(other_low for other_low, other_high in others)),
    )


def _of_envelope(kind: MachineType, s: float) -> Iterator[Figure]:
    """Yield the figures of the working envelope; `s`: size, times the example's."""
    for key, words in kind.envelope:
        typical = _rounded(kind.pin_height * s) if key == "pin_height_m" else None
        yield Figure(key, words, typical, *(_around(typical, LENGTH) if typical else (0.1, 30.0)))


def _of_cylinder(cylinder: Raw, s: float) -> Iterator[Figure]:
    """Yield the figures of a cylinder: number, bore, rod, stroke, closed length.

    cylinder: table of the example's cylinder
    s: size of the machine, times the example's
    """
    name = cylinder["name"]
    yield Figure(f"{name}.count", f"{name}: cylinders side by side", cylinder.get("count", 1), 1, 4, int)
    bore, rod = (_standard(s * cylinder[key]) for key in ("bore_mm", "rod_mm"))
    yield Figure(f"{name}.bore_mm", f"{name} cylinder: bore [mm]", bore, *_around(bore, BORE))
    yield Figure(f"{name}.rod_mm", f"{name} cylinder: rod [mm]", rod, *_around(rod, BORE))
    closed, opened = (1e3 * s * length for length in cylinder["length_range_m"])
    yield Figure(f"{name}.stroke_mm", f"{name} cylinder: stroke [mm]", None, *_around(opened - closed, LENGTH))
    words = f"{name} cylinder: length pin to pin, closed [mm]"
    yield Figure(f"{name}.closed_mm", words, None, *_around(closed, LENGTH))


def _around(typical: float, factors: Range) -> Range:
    """Return the limits around a typical value, in its unit; `factors`: lower and upper limit, times that value."""
    return _rounded(typical * factors[0]), _rounded(typical * factors[1])


def _rounded(value: float) -> float:
    """Return a value with three digits."""
    return float(f"{value:.3g}")


def _standard(mm: float) -> float:
    """Return the nearest diameter [mm] in steps of 5 mm, as cylinders are made, but at least 20 mm."""
    return max(5.0 * round(mm / 5.0), 20.0)


def parsed(figure: Figure, text: str) -> Value:
    """Return the value, in the figure's unit, that a text gives a figure.

    Raises ValueError, which names key, value, limit and cure, for a text of another shape or a value beyond the limits.
    """
    if figure.shape is str:
        if not text.isprintable():
            raise ValueError(f"{figure.key} is {text!r}: write one line of letters, digits and signs")
        return text
    try:
        if "_" in text:  # valid in Python's numbers, not in a data sheet's
            raise ValueError
        if figure.shape is tuple:
            low, high = (float(part) for part in text.strip("[] ").replace(",", ":").split(":"))
            return _checked_range(figure, (low, high))
        number: int | float = figure.shape(text)
    except ValueError as error:
        if str(error).startswith(figure.key):
            raise
        wanted = {int: "a whole number", float: "a number", tuple: "a range LOW:HIGH"}[figure.shape]
        raise ValueError(f"{figure.key} is {text!r}: write {wanted}") from None
    return _checked(figure, number)


def _checked(figure: Figure, number: float) -> float:
    """Return the number of a figure, in the figure's unit. Raises ValueError when it is beyond the figure's limits."""
    if not figure.low <= number <= figure.high:
        raise ValueError(
            f"{figure.key} is {number:g}, machines of this type and size have {figure.low:g} to {figure.high:g}: "
            "check the unit, or give the operating mass of a machine of that size"
        )
    return number


def _checked_range(figure: Figure, given: Range) -> Range:
    """Return the range of a figure, in the figure's unit. Raises ValueError unless it rises, within the limits."""
    if not figure.low <= given[0] < given[1] <= figure.high:
        raise ValueError(
            f"{figure.key} is {given[0]:g}:{given[1]:g}, it must rise and lie within {figure.low:g}:{figure.high:g}: "
            "check the order, the sign and what the angle is measured from"
        )
    return given


def settings(texts: Iterable[str], known: Mapping[str, Figure]) -> dict[str, Value]:
    """Return values by key from texts KEY=VALUE. Raises ValueError with a sentence.

    known: figures of the machine, by key
    """
    values: dict[str, Value] = {}
    for text in texts:
        key, equals, value = (part.strip() for part in text.partition("="))
        if not key or not equals:
            raise ValueError(f"--set {text}: has no {'value' if key else 'key'}: write KEY=VALUE")
        if key not in known:
            close = get_close_matches(key, known, 1)
            cure = f"did you mean {close[0]}" if close else "`cylforce new --list` shows all"
            raise ValueError(f"--set {key}: is no figure of this type of machine: {cure}")
        if key in values:
            raise ValueError(f"--set {key}: is given twice: give it once")
        values[key] = parsed(known[key], value)
    return values
