"""How much of a step each file of the kernel saves when it is compiled, and not interpreted.

One file after the other runs interpreted beside the compiled remainder; all in turn, on the same digging cycle."""

import argparse
import contextlib
import io
import json
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any
from unittest import mock

from rich.console import Console
from rich.table import Table

from bench import recorded_events, step_us
from cylforce.commissioning.identification import identify
from cylforce.estimation.kernel import choice
from cylforce.programs.common.readings import model_of, recorded_segments
from cylforce.programs.sim import run_sim
from cylforce.service.core import Core
from cylforce.settings.machine_file import Loaded, load
from cylforce.signals.events import Event

ROOT = Path(__file__).resolve().parents[2]
FILES = {  # functions of a file that the service calls
    "inputs.py": ("receive", "usable", "stepped", "quantise"),
    "rows.py, bodies.py, columns.py": ("read_channels", "advance", "angle_error_torques", "moving_signals"),
    "weighed.py": ("residual_torque", "gate", "take", "conclude", "weigh_load", "unexplained_torque"),
    "pushed.py": ("tool_force", "published_forces", "learn_noise", "widen_load"),
    "recognised.py": (
        "gather",
        "daily_change",
        "gather_block",
        "torque_per_error",
        "rocking_variance",
        "turn_force",
        "mass_slopes",
    ),
    "drifting.py": ("rows_for_drift", "update_drift"),
    "pressures.py": ("may_step", "possible_steps", "add_group", "compare_groups", "update_noise"),
}


def mixed(interpreted: Sequence[str]) -> Any:  # noqa: ANN401 - the kernel's functions by name
    """Return the compiled kernel with some of its functions interpreted.

    The interpreted functions cannot read the compiled kernel's objects: they get objects made of the same numbers.
    """
    whole, plain = choice.choice().kernel, choice.INTERPRETED
    twins = dict[int, tuple[Any, Any]]()

    def maker(name: str) -> Callable[..., Any]:
        def make(*numbers: Any) -> Any:  # noqa: ANN401
            made = getattr(whole, name)(*numbers)
            twins[id(made)] = made, getattr(plain, name)(*numbers)
            return made

        return make

    def translated(name: str) -> Callable[..., Any]:
        function = getattr(plain, name)

        def call(*arguments: Any) -> Any:  # noqa: ANN401
            return function(*(twins[id(each)][1] if id(each) in twins else each for each in arguments))

        return call

    found = {}
    for name in vars(plain):
        make = maker if name.startswith("Kernel") else translated if name in interpreted else partial(getattr, whole)
        found[name] = make(name)
    return SimpleNamespace(**found)


def prepared(config: Path) -> tuple[Loaded, Any, list[Event]]:
    """Return a machine, its identified parameters and the events of a digging cycle."""
    loaded = load(config)
    with TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        moves, cycle = Path(folder) / "moves.log", Path(folder) / "cycle.log"
        run_sim(config, scenario="moves", seed=1, log=moves)
        run_sim(config, scenario="cycles", cycles=1, seed=1, log=cycle)
        segments = list(recorded_segments(loaded, moves))
        events = list(recorded_events(loaded, cycle))
    return loaded, identify(model_of(loaded), segments).tares, events


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="kernel_files", description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    loaded, tares, events = prepared(ROOT / "config" / "excavator_20t.toml")
    cores = {}
    for name, functions in {"all compiled": (), **FILES}.items():
        with mock.patch.object(choice, "chosen", return_value=mixed(functions)):
            cores[name] = Core(loaded.service, tares)
            step_us(cores[name], events[:2000])
    took: dict[str, list[float]] = {name: [] for name in cores}
    for _ in range(asked.rounds):
        for name, core in cores.items():
            with mock.patch.object(choice, "chosen", return_value=mixed(FILES.get(name, ()))):
                took[name].append(step_us(core, events)[0])
    base = min(took["all compiled"])
    table = Table("interpreted", "us a step", "of the step that compiling it saves", title="files of the kernel")
    figures = {}
    for name, each in took.items():
        step = min(each)
        figures[name] = {"step_us": step, "saved": 1.0 - base / step}
        table.add_row(name, f"{step:.1f}", f"{100.0 * (1.0 - base / step):.0f} %")
    Console().print(table)
    if asked.json:
        asked.json.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
