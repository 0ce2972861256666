"""Reference machines at work: five minutes of empty motion, one known lift, then digging cycles with material that
sticks and spills, fast slewing, slopes, an unsteady hand, and oil that is colder or warmer than at commissioning."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from reference_machine import loader, machine
from reference_machine.cycle import Manner
from reference_machine.recording import Recording

KNOWN = 2.0 / 3.0  # of rated payload: the known weight
SLEW = (0.3, 1.0)  # rad/s, fastest turning
PITCH_DEG, ROLL_DEG = 5.0, 3.0
OIL_DEGC = (0.0, 72.0)  # at the beginning of the work; it warms by eight degrees
COMMISSIONED_DEGC = 40.0
CARRY_BACK = 0.02  # of rated payload: largest
SPILLED = (0.02, 0.06)  # of the load
SPILLS = 0.1  # share of the buckets that lose a part
JERK = 0.012  # m, of every second machine


DRAWN: dict[str, Callable[..., machine.Machine | loader.Loader]] = {
    "excavator": machine.draw,
    "loader": loader.draw,
    "inertial_loader": partial(loader.draw, inertial=True),
}


@dataclass(frozen=True)
class Bucket:
    """A bucket's true weights [kg] when the dumping begins and after it, and its times [s]: free from the ground,
    dumping begins, empty, the next digging begins."""

    gross: float
    carry_back: float
    free: float
    dumps: float
    empty: float
    digs: float


class Ride(NamedTuple):
    """Conditions of the work.

    degrees:      rocking of the base, rms [degrees]
    acceleration: largest acceleration of the driving base [m/s^2]
    oil:          temperature of the oil when the work begins [degC]; None: drawn from OIL_DEGC
    """

    degrees: float = 0.0
    acceleration: float = 0.0
    oil: float | None = None

    @property
    def options(self) -> dict[str, float]:
        """Of a loader's cycles."""
        return {"rock_deg": self.degrees, "drive": self.acceleration} if any(self[:2]) else {}

    @property
    def words(self) -> tuple[str, ...]:
        """Words of a folder's name."""
        moves = tuple(f"{part:g}" for part in self[:2]) if any(self[:2]) else ()
        return moves if self.oil is None else (*moves, f"oil{self.oil:g}")


STANDING = Ride()


def record(kind: str, seed: int, cycles: int, folder: Path, ride: Ride = STANDING) -> Path:
    """FOLDER with commissioning, known lift and work of the machine `seed` of a kind (DRAWN); what is there already
    stays."""
    place = folder / "_".join([kind, str(seed), *ride.words])
    if not (place / "truth" / "work.json").exists():
        drawn = DRAWN[kind](seed, friction=("own", "foreign")[seed % 2])
        drawn.run("commissioning", seed=0, oil_degc=COMMISSIONED_DEGC).write(place)
        known = KNOWN * drawn.specimen.sheet.rated_payload
        drawn.run("known_lift", seed=3, weight_kg=known, oil_degc=COMMISSIONED_DEGC).write(place)
        _work(drawn, seed, cycles, ride).write(place)
    return place


def _work(drawn: machine.Machine | loader.Loader, seed: int, cycles: int, ride: Ride) -> Recording:
    rng = np.random.default_rng((seed, 7))
    rated = drawn.specimen.sheet.rated_payload
    loads = tuple((rated * rng.uniform(0.2, 1.0, cycles)).tolist())
    sticks = tuple((rated * CARRY_BACK * rng.beta(1.0, 2.0, cycles)).tolist())
    falls = tuple(np.where(rng.random(cycles) < SPILLS, rng.uniform(*SPILLED, cycles), 0.0).tolist())
    manner = Manner(sticks, falls, float(rng.uniform(*SLEW)), JERK * (seed // 2 % 2))
    pitch, roll = (float(x) for x in rng.uniform(-1.0, 1.0, 2) * (PITCH_DEG, ROLL_DEG))
    drawn_oil = float(rng.uniform(*OIL_DEGC))
    oil = drawn_oil if ride.oil is None else ride.oil
    where = {"pitch_deg": pitch, "roll_deg": roll, "oil_degc": oil}
    return drawn.run("cycles", seed=2, name="work", payloads_kg=loads, manner=manner, **where, **ride.options)
