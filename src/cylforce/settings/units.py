"""Convert keys with units of a machine file to SI: `scale_bar`, `range_deg`, ... become `scale`, `range`, ..."""

from collections.abc import Iterable, Mapping
from typing import Any

from cylforce.settings.error import FaultError, Inspection, Key, shown
from cylforce.settings.limits import HUGE
from cylforce.signals.kinds import UNIT, Kind
from cylforce.signals.units import BAR, DEGREE, MICROSECOND, MILLIMETRE, MILLISECOND, STANDARD_GRAVITY, ZERO_CELSIUS

# SI unit -> suffix of the key -> size in SI; the zero of each lies at 0 SI, but for degrees Celsius
SUFFIXES: dict[str, dict[str, float]] = {
    "Pa": {"bar": BAR, "mpa": 1e6, "kpa": 1e3, "pa": 1.0},
    "N": {"kn": 1e3, "n": 1.0},
    "rad": {"deg": DEGREE, "rad": 1.0},
    "m": {"mm": MILLIMETRE, "m": 1.0},
    "rad/s": {"deg_s": DEGREE, "rad_s": 1.0},
    "m/s^2": {"m_s2": 1.0, "g": STANDARD_GRAVITY},
    "K": {"degc": 1.0, "k": 1.0},
    "s": {"s": 1.0, "ms": MILLISECOND, "us": MICROSECOND},
}
ZERO = {"degc": ZERO_CELSIUS}  # SI value of zero, by suffix
WORDS = ("scale", "offset", "range", "standard_error")  # keys of a sensor that are written with a unit
COLUMN = ("scale", "offset")  # keys of a recording's column that are written with a unit
ANY = (0.0, 1.0)  # stands for a range that cannot be read: the file is refused, but its other keys are checked


def file_in_si(raw: Mapping[str, Any], findings: Inspection) -> dict[str, Any]:
    """Return the whole file with SI values in the sensors' tables and the time column; every error goes to `findings`.

    The signals' columns are converted in `signals.columns`, which knows their kinds. `raw` is not changed.
    """
    sensors, table = raw.get("sensors"), raw.get("table")
    out = dict(raw)
    if isinstance(sensors, list):
        out["sensors"] = [_sensor_in_si(one, ("sensors", k), findings) for k, one in enumerate(sensors)]
    if isinstance(table, dict) and isinstance(table.get("time"), dict):
        time = in_si(table["time"], "s", ("scale",), ("table", "time"), findings)
        out["table"] = {**table, "time": time}
    return out


def _sensor_in_si(raw: object, key: Key, findings: Inspection) -> object:
    """Return a sensor's table in SI; one of unknown kind with the range ANY and without the keys that have units.

    Anything but a table is returned unchanged.
    """
    if not isinstance(raw, dict):
        return raw
    kind = raw.get("kind")
    if isinstance(kind, str) and kind in UNIT:
        return in_si(raw, UNIT[Kind(kind)], WORDS, key, findings)
    any_unit = {f"{word}_{suffix}" for word in WORDS for table in SUFFIXES.values() for suffix in table}
    return {"range": ANY, **{name: value for name, value in raw.items() if name not in any_unit}}


def in_si(raw: Mapping[str, Any], unit: str, words: tuple[str, ...], key: Key, findings: Inspection) -> dict[str, Any]:
    """Return a table with `WORD_SUFFIX` replaced by `WORD` in SI; all keys of one table must share one suffix.

    Errors go to `findings`. A key that cannot be converted is omitted; mixed units are an error, too, but their keys
    remain. If `range` is among `words` and missing, this is an error; ANY stands for it, or for one that cannot be
    converted, so that the other keys can be checked. If `offset` is among `words` and missing, and another key has a
    unit, it becomes the SI value of zero in that unit. Only to offset and range is this zero added (`_zero`).

    unit: SI unit of the quantity
    words: keys, without their units, that are written with a unit
    key: key of the table in the file
    """
    suffixes, used, out = SUFFIXES[unit], list[str](), dict(raw)
    findings.errors.extend(_unit_faults(raw, suffixes, words, key))
    for name in _wrong(raw, suffixes, words):
        del out[name]
    for word in words:
        for suffix, size in suffixes.items():
            if f"{word}_{suffix}" in out:
                used.append(suffix)
                value = out.pop(f"{word}_{suffix}")
                out[word] = findings.attempt(_si, (*key, f"{word}_{suffix}"), value, size, _zero(word, suffix))
    if len(set(used)) > 1:
        problem = f"mixes the units {' and '.join(sorted(set(used)))}: use one"
        findings.errors.append(FaultError(key, problem))
    if used and "offset" in words and "offset" not in out:
        out["offset"] = ZERO.get(used[0], 0.0)
    return _filled({word: value for word, value in out.items() if value is not None}, words)


def _filled(table: dict[str, Any], words: tuple[str, ...]) -> dict[str, Any]:
    """Return a table, with the range ANY if `range` is among its `words` and it has none."""
    return {"range": ANY, **table} if "range" in words else table


def _zero(word: str, suffix: str) -> float:
    """Return the SI value of zero in a unit; 0 for scale and standard error, which are differences."""
    return ZERO.get(suffix, 0.0) if word in ("offset", "range") else 0.0


def _wrong(raw: Mapping[str, Any], suffixes: Mapping[str, float], words: tuple[str, ...]) -> list[str]:
    """Return the keys of a table without a unit or with the unit of another quantity.

    suffixes: units that the keys may have
    words: keys without their units
    """
    foreign = {suffix for table in SUFFIXES.values() for suffix in table} - set(suffixes)
    return [name for word in words for name in (word, *(f"{word}_{s}" for s in sorted(foreign))) if name in raw]


def _unit_faults(
    raw: Mapping[str, Any], suffixes: Mapping[str, float], words: tuple[str, ...], key: Key
) -> Iterable[FaultError]:
    """Yield a fault for each key without a unit or with that of another quantity, and one for a missing range.

    suffixes: units that the keys may have, each with its size in SI
    words: keys without their units
    key: key of the table `raw`
    """
    wrong = _wrong(raw, suffixes, words)
    for name in wrong:
        word = next(word for word in words if name == word or name.startswith(f"{word}_"))
        allowed = " or ".join(_keys(word, suffixes))
        problem = "has no unit" if name == word else "has the unit of another quantity"
        yield FaultError((*key, name), f"{problem}: write {allowed}")
    if "range" in words and not any(name.split("_")[0] == "range" for name in wrong):
        names = _keys("range", suffixes)
        if not any(name in raw for name in names):
            problem = f"lacks the range of values that can be true: add {' or '.join(names)} = [low, high]"
            yield FaultError(key, problem, names)


def _keys(word: str, suffixes: Mapping[str, float]) -> list[str]:
    """Return a key with each of the units that it may have."""
    return [f"{word}_{suffix}" for suffix in suffixes]


def _si(key: Key, value: object, size: float, zero: float) -> object:
    """Return a number or a range in SI: value size + zero. Raises FaultError.

    key: key of the value
    value: number or [low, high], in the unit of its key
    size: size of that unit [SI]
    zero: SI value of zero in that unit
    """
    if isinstance(value, list):
        converted = tuple(_si(key, one, size, zero) for one in value)
        if len(value) == 2 and not value[0] < value[1]:
            raise FaultError(key, f"is {shown(value)}: the first number must be the smaller one")
        return converted
    if isinstance(value, bool) or not isinstance(value, int | float) or not -HUGE < value < HUGE:
        raise FaultError(key, f"is {shown(value)}: it must be a finite number")
    return value * size + zero
