"""Units in the keys of a machine file: `scale_bar`, `range_deg`, ... become `scale`, `range`, ... in SI."""

from collections.abc import Mapping

from cylforce.signals.kinds import UNIT, Kind
from cylforce.signals.units import BAR, DEGREE, MICROSECOND, MILLIMETRE, ZERO_CELSIUS

# SI unit -> suffix of the key -> size in SI; the zero of each lies at 0 SI, but for degrees Celsius
SUFFIXES: dict[str, dict[str, float]] = {
    "Pa": {"bar": BAR, "mpa": 1e6, "kpa": 1e3, "pa": 1.0},
    "N": {"kn": 1e3, "n": 1.0},
    "rad": {"deg": DEGREE, "rad": 1.0},
    "m": {"mm": MILLIMETRE, "m": 1.0},
    "rad/s": {"deg_s": DEGREE, "rad_s": 1.0},
    "K": {"degc": 1.0, "k": 1.0},
    "s": {"s": 1.0, "ms": MILLIMETRE, "us": MICROSECOND},
}
ZERO = {"degc": ZERO_CELSIUS}
HUGE = 1e12  # beyond this nothing is a measurement, and squares overflow
WORDS = ("scale", "offset", "range", "standard_error")


def kind_in_si(raw: Mapping[str, object], words: tuple[str, ...] = WORDS) -> dict[str, object]:
    """`in_si` by the unit of `raw["kind"]`; as it is when there is no such kind."""
    kind = raw.get("kind")
    return in_si(raw, UNIT[Kind(kind)], words) if isinstance(kind, str) and kind in UNIT else dict(raw)


def in_si(raw: Mapping[str, object], unit: str, words: tuple[str, ...] = WORDS) -> dict[str, object]:
    """The table with `WORD_SUFFIX` replaced by `WORD` in SI; all keys of one table must share one suffix.

    Raises ValueError with a sentence that names the key."""
    suffixes, used, out = SUFFIXES[unit], set(), dict(raw)
    _check_units(raw, suffixes, words)
    for word in words:
        for suffix, size in suffixes.items():
            key = f"{word}_{suffix}"
            if key in out:
                used.add(suffix)
                zero = 0.0 if word in ("scale", "standard_error") else ZERO.get(suffix, 0.0)
                out[word] = _si(key, out.pop(key), size, zero)
    if len(used) > 1:
        raise ValueError(f"mixes the units {' and '.join(sorted(used))}: use one")
    if used and "offset" in words and "offset" not in out:
        out["offset"] = ZERO.get(used.pop(), 0.0)
    return out


def _check_units(raw: Mapping[str, object], suffixes: Mapping[str, float], words: tuple[str, ...]) -> None:
    """Refuses keys without a unit and with another quantity's, and a range that is not given at all."""
    foreign = {suffix for table in SUFFIXES.values() for suffix in table} - set(suffixes)
    for word in words:
        here = " or ".join(f"{word}_{suffix}" for suffix in suffixes)
        if word in raw:
            raise ValueError(f"has {word} without a unit: write {here}")
        for suffix in foreign & {key.removeprefix(f"{word}_") for key in raw if key.startswith(f"{word}_")}:
            raise ValueError(f"has {word}_{suffix}, the unit of another quantity: write {here}")
        if word == "range" and not any(f"range_{suffix}" in raw for suffix in suffixes):
            raise ValueError(f"lacks the values that are believed: add {here} = [low, high]")


def _si(key: str, value: object, size: float, zero: float) -> object:
    if isinstance(value, list):
        return tuple(_si(key, one, size, zero) for one in value)
    if isinstance(value, bool) or not isinstance(value, int | float) or not -HUGE < value < HUGE:
        raise ValueError(f"has {key} = {shown(value)}: it must be a finite number")
    return value * size + zero


def shown(value: object) -> str:
    """A value of the file for a message, cut short."""
    try:
        text = repr(value)
    except ValueError:  # an integer of more digits than Python prints
        return "a number of thousands of digits"
    return text if len(text) <= 40 else text[:37] + "..."
