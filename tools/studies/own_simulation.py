"""First use of a simulation engineer: `cylforce gap --simulation` with a simulation whose masses are not the machine's.

The machine is ours with masses off by a fraction, and with one hidden effect or none. The simulation is the same
machine file without both. How often is the answer "identify the machine first", how often is a wrong effect named, how
often the hidden one? Each effect is hidden twice: in the middle of its plausible range and twice as large. One that
leaves less than VISIBLE noise floors once masses and friction are fitted is no question of the diagnosis: the
parameters take it up."""

import argparse
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.console import Console
from rich.progress import track
from rich.table import Table

from cylforce.programs.common.gap_question import Question
from cylforce.programs.gap import diagnose
from cylforce.programs.sim import run_sim
from cylforce.settings.machine_file import Loaded, load

CONFIG = Path(__file__).resolve().parents[2] / "config"
MACHINE = CONFIG / "excavator_20t.toml"
MOVES_S = 150.0
VISIBLE = 2.5  # noise floors that are left after a refit, at the worst joint
MOST = 2.0  # times the middle
HIDDEN: tuple[tuple[str, str, tuple[float, ...]], ...] = (  # name, place, sizes [SI]: about the middle of the plausible
    ("", "", ()),
    ("angle_offset", "stick_angle", (0.015,)),
    ("angle_scale", "boom_angle", (0.03,)),
    ("backlash", "bucket", (0.015,)),
    ("encoder_eccentricity", "boom_angle", (0.02, 0.0)),
    ("hose_spring", "stick", (1500.0,)),
    ("linkage_geometry", "bucket", (0.012, 0.0)),
    ("pressure_gain", "boom_head_pressure", (0.03,)),
    ("pressure_sensor_hysteresis", "stick_head_pressure", (250e3,)),
    ("return_line_loss", "bucket", (12e3, 12e3)),
    ("sensor_delay", "stick_angle", (0.05,)),
    ("stribeck", "stick", (3000.0,)),
)


@dataclass(frozen=True)
class Answer:
    """Answer of the diagnosis, with the effect that was hidden.

    hidden:   name and place of the hidden effect; two empty texts if there is none
    verdict:  of the diagnosis
    refit:    share of the gap that the parameters remove; 0 where they are not named
    left:     residual after the refit at the worst joint, in noise floors
    effects:  named effects (name, place)
    sure:     confidence of the first of them
    """

    hidden: tuple[str, str]
    verdict: str
    refit: float
    left: float
    effects: list[tuple[str, str]]
    sure: float

    @property
    def wrong(self) -> bool:
        """Whether another effect than the hidden one is named first, 80 % sure."""
        return bool(self.effects) and self.sure >= 0.8 and self.effects[0] != self.hidden


def asked(
    loaded: Loaded, hidden: tuple[str, str, tuple[float, ...]], seed: int, mass_error: float, folder: Path
) -> Answer:
    """Simulate both and ask."""
    name, at, sizes = hidden
    effects = None
    if name:
        effects = folder / "effects.toml"
        effects.write_text(f'[[effects]]\nname = "{name}"\nat = "{at}"\nvalue = {list(sizes)}\n')
    field, own = folder / "field.csv", folder / "simulation.csv"
    run_sim(MACHINE, scenario="moves", duration=MOVES_S, seed=seed, mass_error=mass_error, effects=effects, table=field)
    run_sim(MACHINE, scenario="moves", duration=MOVES_S, seed=seed + 1, mass_error=0.0, table=own)
    answer = diagnose(loaded, Question((field,), simulation=(own,))).answer
    named = [(e["name"], e["at"]) for e in answer["effects"]]
    sure = answer["effects"][0]["confidence"] if named else 0.0
    left = max(joint["refit"] / joint["floor"] for joint in answer["gap"]["joints"].values())
    return Answer((name, at), answer["verdict"], answer.get("identify_first", {}).get("share", 0.0), left, named, sure)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="accuracy own_simulation", description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--mass-error", type=float, default=0.1, help="of the machine against the simulation")
    parser.add_argument("--json", type=Path)
    wanted = parser.parse_args()
    loaded, found = load(MACHINE), list[Answer]()
    larger = [(name, at, tuple(MOST * size for size in sizes)) for name, at, sizes in HIDDEN if name]
    for k, hidden in enumerate(track([*HIDDEN, *larger], "asking")):
        with TemporaryDirectory() as name:
            found.append(asked(loaded, hidden, wanted.seed + 10 * k, wanted.mass_error, Path(name)))
    table = Table(title=f"Own simulation, masses off by {wanted.mass_error:.0%}, seed {wanted.seed}")
    for column in ("hidden", "verdict", "refit removes", "leaves, in floors", "effects named"):
        table.add_column(column)
    for each in found:
        named = ", ".join(" at ".join(effect) for effect in each.effects)
        place = " at ".join(filter(None, each.hidden)) or "-"
        table.add_row(place, each.verdict, f"{each.refit:.1%}", f"{each.left:.1f}", named or "-")
    Console().print(table)
    hiding = [each for each in found if each.hidden[0] and each.left >= VISIBLE]
    print(
        f"identify first: {sum(each.refit > 0.0 for each in found)} of {len(found)}; "
        f"a wrong name, 80 % sure: {sum(each.wrong for each in found)} of {len(found)}; "
        f"the hidden effect named: {sum(each.hidden in each.effects for each in hiding)} of {len(hiding)} that a refit "
        f"leaves visible"
    )
    if wanted.json:
        wanted.json.write_text(json.dumps([asdict(each) for each in found], indent=1) + "\n")


if __name__ == "__main__":
    main()
