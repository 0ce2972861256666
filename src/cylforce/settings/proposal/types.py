"""The types of machine that `cylforce new` supports: which shipped machine file has their typical proportions."""

from collections.abc import Mapping
from typing import Any, NamedTuple

Raw = Mapping[str, Any]  # a machine file as TOML gives it
Range = tuple[float, float]


class MachineType(NamedTuple):
    """A type of machine.

    words: description for a list
    title: name of such a machine
    example: shipped machine file with typical proportions; frames are those of the example
    tonnes: operating mass of the example [t]
    pin_height: height of the first joint's pin above the ground, of the example [m]
    envelope: figures of the working envelope from which the first joint's range follows: key and meaning
    """

    words: str
    title: str
    example: str
    tonnes: float
    pin_height: float = 0.0
    envelope: tuple[tuple[str, str], ...] = ()


PIN_HEIGHT = ("pin_height_m", "height of the first joint's pin above the ground [m]")
TYPES = {
    "excavator": MachineType(
        "excavator with boom, stick and bucket, three cylinders",
        "Excavator",
        "excavator_20t.toml",
        20.0,
        1.8,
        (
            PIN_HEIGHT,
            ("dig_depth_m", "maximum digging depth [m]"),
            ("cut_height_m", "maximum cutting height [m]"),
        ),
    ),
    "stick_bucket": MachineType(
        "excavator of which stick and bucket are measured; the boom stands still",
        "Excavator, stick and bucket",
        "excavator_stick_bucket.toml",
        20.0,
    ),
    "wheel_loader": MachineType(
        "wheel loader with Z-bar, lift and tilt cylinders",
        "Wheel loader",
        "wheel_loader.toml",
        15.0,
        1.95,
        (
            PIN_HEIGHT,
            ("hinge_low_m", "height of the bucket's pin, arm lowered [m]"),
            ("hinge_height_m", "height of the bucket's pin, arm raised [m]"),
        ),
    ),
}
ENVELOPE = tuple(key for kind in TYPES.values() for key, _ in kind.envelope if key != PIN_HEIGHT[0])
LIGHTEST, HEAVIEST = 0.8, 100.0  # t: mini excavators to the largest that are transported in one piece


def machine_type(name: str) -> MachineType:
    """Return the type of this name. Raises ValueError with a sentence."""
    if name not in TYPES:
        raise ValueError(f"--type is {name!r}, which is no type of machine: write one of {', '.join(TYPES)}")
    return TYPES[name]


def operating_mass(text: str) -> float:
    """Return the operating mass [t] that a text gives. Raises ValueError with a sentence."""
    try:
        if "_" in text:  # valid in Python's numbers, not in a data sheet's
            raise ValueError
        tonnes = float(text)
    except ValueError:
        raise ValueError(f"--tonnes is {text!r}: write the operating mass in tonnes, a number") from None
    if not LIGHTEST <= tonnes <= HEAVIEST:
        limits = f"it must be {LIGHTEST:g} to {HEAVIEST:g}"
        raise ValueError(f"--tonnes is {tonnes:g}, {limits}: give the operating mass in tonnes")
    return tonnes


def size(kind: MachineType, tonnes: float) -> float:
    """Return the length of a machine relative to its type's example: the cube root of the ratio of operating masses.

    tonnes: operating mass [t]
    """
    return float((tonnes / kind.tonnes) ** (1.0 / 3.0))
