"""Units in the keys of a machine file: `scale_bar`, `range_deg`, ... become `scale`, `range`, ... in SI."""

from collections.abc import Mapping
from math import isfinite

from cylforce.words.signals import UNIT, Kind
from cylforce.words.units import BAR, DEGREE, MICROSECOND, MILLIMETRE, ZERO_CELSIUS

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
WORDS = ("scale", "offset", "range", "standard_error")


def kind_in_si(raw: Mapping[str, object], words: tuple[str, ...] = WORDS) -> dict[str, object]:
    """`in_si` by the unit of `raw["kind"]`; as it is when there is no such kind."""
    kind = raw.get("kind")
    return in_si(raw, UNIT[Kind(kind)], words) if isinstance(kind, str) and kind in UNIT else dict(raw)


def in_si(raw: Mapping[str, object], unit: str, words: tuple[str, ...] = WORDS) -> dict[str, object]:
    """The table with `WORD_SUFFIX` replaced by `WORD` in SI; all keys of one table must share one suffix.

    Raises ValueError with a sentence that names the key."""
    suffixes, used, out = SUFFIXES[unit], set(), dict(raw)
    for word in words:
        if word in out:
            raise ValueError(f"has {word} without a unit: write {' or '.join(f'{word}_{s}' for s in suffixes)}")
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


def _si(key: str, value: object, size: float, zero: float) -> object:
    if isinstance(value, list):
        return tuple(_si(key, one, size, zero) for one in value)
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        raise ValueError(f"has {key} = {value!r}: it must be a finite number")
    return value * size + zero
