"""Scale an example's tables of a machine file to the figures of a data sheet."""

from collections.abc import Callable, Iterator, Mapping
from copy import deepcopy
from typing import Any, NamedTuple

from cylforce.settings.proposal.envelope import HINGES, check_hinges, first_range
from cylforce.settings.proposal.figures import Value, reached_over
from cylforce.settings.proposal.pins import driven, fit_pins
from cylforce.settings.proposal.types import ENVELOPE, MachineType, Range, Raw, size

Tables = dict[str, Any]
Values = Mapping[str, Any]
UNKNOWN_MASS, UNKNOWN_INERTIA = 30.0, 50.0  # per cent by which machines of one size class differ; chosen
UNKNOWN_BORE = 0.05  # tolerance of a typical bore, times the bore: cylinders differ by a step of 5 mm or two
MOST_BORE = 10.0  # mm, largest tolerance of a typical bore: bores are made in steps of 5 to 20 mm
CENTRE = 0.1  # tolerance of a scaled centre of gravity, times the link's length; chosen
NEAR_END = 0.2  # share of a link's length: a pin nearer to an end keeps its scaled distance from that end; chosen
SENSOR_ROOM = 5.0  # deg beyond the joint's range that an angle sensor's range covers; chosen
NARROWING_STEPS = 9  # steps by which a range is narrowed at most: to 70 % of it; chosen
NARROWING_STEP = 1.0 / 30.0  # one such step, times the range; chosen


class ProposedMachine(NamedTuple):
    """A proposed machine.

    tables: tables of its machine file
    narrowed: by key of `figures` the typical angle ranges [deg] that were narrowed because a cylinder could not cover
        them
    """

    tables: Tables
    narrowed: dict[str, Range]


def proposal(
    kind: MachineType, raw: Raw, tonnes: float, values: Mapping[str, Value], given: frozenset[str]
) -> ProposedMachine:
    """Return the example's machine with the given figures: scaled, and its pins fitted to the cylinders.

    Raises ValueError, in a sentence, for figures that do not fit together.

    raw: tables of the type's example
    tonnes: operating mass [t]
    values: by key of `figures`; None: it follows from the others
    given: keys that came from the data sheet and are not typical
    """
    s = size(kind, tonnes)
    tables: Tables = deepcopy(dict(raw))
    _set_machine(tables, values, s)
    for k in range(len(tables["links"])):
        _set_link(tables, raw, k, values, given, s)
    ranges = _ranges(kind, tables, values, given, s)
    narrowed: dict[str, Range] = {}
    _set_ranges(tables, raw, ranges)
    for k in range(len(tables["cylinders"])):
        _set_cylinder(tables, raw, k, values, given, s)
        narrowed |= _fit(tables, raw, k, ranges, _given_lengths(values, raw["cylinders"][k], s), given)
    _set_bus(tables, values)
    force = raw["publication"]["rated_force_n"]
    tables["publication"]["rated_force_n"] = min(
        force, round(force * s**3, -3)
    )  # its object on the bus holds little more
    return ProposedMachine(tables, narrowed)


def _set_machine(tables: Tables, values: Values, s: float) -> None:
    """Set name, rated payload, reach and slew axis in the table of the machine.

    s: size of the machine, times the example's
    """
    machine = tables["machine"]
    machine |= {"name": values["name"], "rated_payload_kg": values["rated_payload_kg"]}
    for key in ("payload_reach_m", "slew_axis_m"):
        if key in machine:
            machine[key] = round(s * machine[key], 2)


def _length(tables: Raw, k: int) -> float:
    """Return the length of link k from its inner pin to its outer one [m]; of the last one x of the tooth line."""
    return float(tables["links"][k].get("length_m", tables["tool"]["point_m"][0]))


def _set_link(tables: Tables, raw: Raw, k: int, values: Values, given: frozenset[str], s: float) -> None:
    """Set length, mass, centre of gravity, inertia and tolerances of link k.

    raw: tables of the type's example
    values: figures by key
    given: keys that came from the data sheet
    s: size of the machine, times the example's
    """
    link, name = tables["links"][k], tables["links"][k]["name"]
    length, mass = values[f"{name}.length_m"], values[f"{name}.mass_kg"]
    longer, heavier = length / _length(raw, k), mass / link["mass_kg"]
    if "length_m" in link:
        link["length_m"] = length
    else:
        tables["tool"]["point_m"] = [length, round(s * tables["tool"]["point_m"][1], 3)]
    x, z = link["centre_m"]
    link |= {"mass_kg": mass, "centre_m": [round(longer * x, 3), round(s * z, 3)]}
    link["inertia_kg_m2"] = float(f"{link['inertia_kg_m2'] * heavier * longer**2:.3g}")
    link["tolerance"] = {
        "mass_percent": link["tolerance"]["mass_percent"] if f"{name}.mass_kg" in given else UNKNOWN_MASS,
        "centre_m": round(CENTRE * length, 3),
        "inertia_percent": UNKNOWN_INERTIA,
    }


def _ranges(kind: MachineType, tables: Tables, values: Values, given: frozenset[str], s: float) -> list[Range]:
    """Return the angle range [deg] of each link as figures give it.

    The range of a link whose cylinder reaches over others is measured from the chassis.

    values: figures by key
    given: keys that came from the data sheet
    s: size of the machine, times the example's
    """
    lengths = [_length(tables, k) for k in range(len(tables["links"]))]
    wanted = [values[f"{link['name']}.angle_range_deg"] for link in tables["links"]]
    if f"{tables['links'][0]['name']}.angle_range_deg" in given:
        check_hinges(wanted[0], lengths[0], values, given)
        values = {key: value for key, value in values.items() if key not in HINGES}
    return [first_range(kind, lengths, wanted, values, s), *wanted[1:]]


def _set_ranges(tables: Tables, raw: Raw, ranges: list[Range]) -> None:
    """Set the joints' angle ranges [deg] in `tables` from those of `_ranges`.

    A range from the chassis becomes that of the joint: large enough at every angle of the joints reached over.
    """
    for k, link in enumerate(tables["links"]):
        others = [ranges[i] for i in reached_over(raw, k)]
        low, high = ranges[k][0] - sum(o[1] for o in others), ranges[k][1] - sum(o[0] for o in others)
        link["angle_range_deg"] = [round(low, 1), round(high, 1)]


def _fit(
    tables: Tables, raw: Raw, k: int, ranges: list[Range], wanted: Range | None, given: frozenset[str]
) -> dict[str, Range]:
    """Fit the pins of cylinder k; return the range [deg] that was narrowed for it, by its key, else nothing.

    Linkage and lengths of the cylinder and the joints' ranges are changed in `tables`. A typical range is narrowed in
    `ranges` until pins fit. Raises ValueError where none fit, or, with the widest range that fits, where the range was
    given.

    ranges: angle range of each link [deg], as of `_ranges`
    wanted: closed and open length of the cylinder [m]; None: not given
    given: keys that came from the data sheet
    """
    j, start = driven(tables, k), deepcopy(tables["cylinders"][k])
    key, first = f"{tables['links'][j]['name']}.angle_range_deg", ranges[j]

    def fit(tried: Range) -> None:
        """Fit the pins for a range [deg]. Raises ValueError."""
        ranges[j], tables["cylinders"][k] = tried, deepcopy(start)
        _set_ranges(tables, raw, ranges)
        fit_pins(tables, k, wanted, tried)

    try:
        fit(first)
    except ValueError as error:
        narrower = _widest_fitting(first, fit)
        if narrower is None:
            raise
        if key in given or (j == 0 and given & set(ENVELOPE)):
            low, high = narrower
            raise ValueError(f"{error}; the widest range that fits is about {low:g}:{high:g}") from error
        return {key: narrower}
    return {}


def _narrowed(wanted: Range) -> Iterator[Range]:
    """Yield narrower ranges [deg] within `wanted`, the widest first; of equally wide ones the most central first."""
    low, high = wanted
    step = NARROWING_STEP * (high - low)
    for count in range(1, NARROWING_STEPS + 1):
        for below in sorted(range(count + 1), key=lambda part: abs(2 * part - count)):
            yield round(low + below * step, 1), round(high - (count - below) * step, 1)


def _widest_fitting(wanted: Range, fit: Callable[[Range], None]) -> Range | None:
    """Return the first narrower range for which `fit` raises no ValueError; None where it raises one for each."""
    for narrower in _narrowed(wanted):
        try:
            fit(narrower)
        except ValueError:
            continue
        return narrower
    return None


def _set_cylinder(tables: Tables, raw: Raw, k: int, values: Values, given: frozenset[str], s: float) -> None:
    """Set dimensions, tolerances and scaled linkage of cylinder k. Raises ValueError where rod and bore do not fit.

    raw: tables of the type's example
    values: figures by key
    given: keys that came from the data sheet
    s: size of the machine, times the example's
    """
    cylinder, name = tables["cylinders"][k], tables["cylinders"][k]["name"]
    count, bore, rod = (values[f"{name}.{key}"] for key in ("count", "bore_mm", "rod_mm"))
    if rod >= bore:
        raise ValueError(f"{name}.rod_mm is {rod:g}, its bore {bore:g}: a rod is thinner; exchange or correct them")
    if count > 1 or "count" in cylinder:
        cylinder["count"] = count
    cylinder |= {"bore_mm": bore, "rod_mm": rod}
    error = 0.1 if f"{name}.bore_mm" in given else min(round(UNKNOWN_BORE * bore, 1), MOST_BORE)
    cylinder["tolerance"] = {"bore_mm": error, "pins_m": round(values["pins_mm"] / 1e3, 4)}
    linkage = cylinder["linkage"]
    outer = linkage.get("rocker_pin", {}).get("body")
    for key, part in linkage.items():
        if isinstance(part, Mapping):
            linkage[key] = {"body": part["body"], "at_m": _moved(tables, raw, part, s, part["body"] == outer)}
        elif key.endswith("_m"):
            linkage[key] = [s * p for p in part] if isinstance(part, list) else s * part


def _moved(tables: Tables, raw: Raw, pin: Raw, s: float, outer: bool) -> list[float]:
    """Return the place of a pin of the example on the new machine [m].

    Along its link the pin keeps its distance, times the size, from the end that it is near to (NEAR_END). In the middle
    it keeps its share of the length. Across the link, on the chassis and on the last link, all is scaled by the size.

    s: size of the machine, times the example's
    outer: keep the distance from the outer end, as for a link with a rocker: the same linkage is used on longer and
        shorter links
    """
    x, z = pin["at_m"]
    names = [link["name"] for link in raw["links"]]
    if pin["body"] not in names[:-1]:
        return [s * x, s * z]
    k = names.index(pin["body"])
    before, after = _length(raw, k), _length(tables, k)
    if outer or x > (1.0 - NEAR_END) * before:
        return [after - s * (before - x), s * z]
    return [s * x if x < NEAR_END * before else x * after / before, s * z]


def _given_lengths(values: Values, cylinder: Raw, s: float) -> tuple[float, float] | None:
    """Return closed and open length [m] from the data sheet; None where neither stroke nor closed length is given.

    If one of them is missing, it follows from the example: closed length less stroke is scaled with the size. Raises
    ValueError, in a sentence, unless the closed length exceeds the stroke.

    values: figures by key, stroke and closed length in mm
    cylinder: table of the example's cylinder, whose lengths are in m
    s: size of the machine, times the example's
    """
    stroke, closed = (values[f"{cylinder['name']}.{key}"] for key in ("stroke_mm", "closed_mm"))
    if stroke is None and closed is None:
        return None
    low, high = cylinder["length_range_m"]
    dead = 1e3 * s * (2.0 * low - high)  # mm, closed length less stroke
    stroke = closed - dead if stroke is None else stroke
    closed = stroke + dead if closed is None else closed
    if not 0.0 < stroke < closed:
        raise ValueError(
            f"{cylinder['name']}.closed_mm is {closed:g}, its stroke {stroke:g}: pin to pin, a cylinder is longer than "
            "its stroke; correct one of them"
        )
    return closed / 1e3, (closed + stroke) / 1e3


def _set_bus(tables: Tables, values: Values) -> None:
    """Set the node-IDs and remove the identities of the nodes; set the ranges of the joints' angle sensors."""
    for node in tables["nodes"]:
        node["node_id"] = values[f"{node['name']}.node_id"]
        node.pop("identity", None)  # the example's sensors are others
    ranges = {link["name"]: link["angle_range_deg"] for link in tables["links"]}
    for sensor in tables["sensors"]:
        if sensor["kind"] == "joint_angle":
            low, high = ranges[sensor["at"]]
            sensor["range_deg"] = [low - SENSOR_ROOM, high + SENSOR_ROOM]
