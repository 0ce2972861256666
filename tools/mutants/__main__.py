"""Mutation score of the rooms in which a mistake would be told to the outside: in a copy of the repository mistakes are
made, one at a time, and the tests of that room run. A mistake that no test notices survives."""

import argparse
import json
import os
import random
import shutil
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from rich.console import Console
from rich.table import Table

from .changes import Mutation, mutations

ROOT = Path(__file__).resolve().parents[2]
SOURCE = Path("src/cylforce")
PATIENCE, LEAST_S = 4.0, 20.0  # times the tests' own time, and seconds, after which a mistake hangs them: noticed


class Room(NamedTuple):
    """Files whose mistakes are asked for (below src/cylforce), and tests (below tests) that should notice them."""

    files: tuple[str, ...]
    tests: tuple[str, ...]


ROOMS = {
    "codec": Room(("signals/codec.py",), ("signals/test_codec.py",)),
    "assembler": Room(
        ("service/assembler.py", "service/senders/*.py", "estimation/kernel/inputs.py"),
        (
            "service/test_published_codes.py",
            "service/test_assembler.py",
            "estimation/kernel/test_kernel_parts.py",
            "service/senders/test_senders.py",
            "service/test_bad_input.py",
        ),
    ),
    "gates": Room(
        ("service/service.py", "service/force.py", "service/recognition.py", "signals/estimate.py"),
        (
            "service/test_published_codes.py",
            "service/test_tool_check.py",
            "service/test_recognition.py",
            "service/test_outage.py",
            "service/test_truth_at_rest.py",
            "service/test_bad_input.py",
        ),
    ),
    "plausibility": Room(
        ("service/plausibility/*.py", "service/plausibility/detectors/*.py", "estimation/kernel/pressures.py"),
        (
            "service/test_published_codes.py",
            "service/plausibility/test_reversals.py",
            "service/plausibility/test_frozen_at_rest.py",
            "service/plausibility/test_revoked_steps.py",
            "service/plausibility/test_pressure_steps.py",
            "service/plausibility/test_plausibility.py",
            "service/plausibility/test_undetected.py",
        ),
    ),
    "store": Room(
        (
            "records/recorder.py",
            "records/writing.py",
            "records/schema.py",
            "records/audit.py",
            "files/atomic.py",
            "files/checkpoint.py",
        ),
        (
            "files/test_stored_files.py",
            "records/test_audit.py",
            "records/test_records.py",
            "programs/common/test_recorded.py",
            "programs/test_restart.py",
            "files/test_logfile.py",
        ),
    ),
}


class Mutant(NamedTuple):
    """A mistake in a file of a room."""

    room: str
    path: Path
    mutation: Mutation

    def told(self) -> str:
        """Where it is and what, in a line."""
        text, (line, begin, end, instead) = (ROOT / self.path).read_text(), self.mutation
        return f"{self.room}: {self.path}:{line}: {text[begin:end]!r} -> {instead!r}"


def drawn(rooms: list[str], size: int, seed: int) -> list[Mutant]:
    """So many mistakes of each room, at random."""
    rng, found = random.Random(seed), []
    for room in rooms:
        paths = sorted(p for pattern in ROOMS[room].files for p in (ROOT / SOURCE).glob(pattern))
        each = [Mutant(room, p.relative_to(ROOT), m) for p in paths for m in mutations(p.read_text())]
        found += rng.sample(each, min(size, len(each)))
    return found


def copied(folder: Path) -> None:
    """The repository with what is built in it, without its history."""
    listed = subprocess.check_output(["git", "ls-files", "-co", "--exclude-standard", "-z"], cwd=ROOT, text=True)
    built = [str(p.relative_to(ROOT)) for p in (ROOT / SOURCE).rglob("*.so")]
    for name in [*filter(None, listed.split("\0")), *built]:
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)


def passed(folder: Path, room: str, limit_s: float | None = None) -> bool:
    """Whether the room's tests pass in a copy, within a time."""
    shared = os.environ.get("CYLFORCE_SHARED", str(ROOT.parent / "shared"))
    tests = [f"tests/{name}" for name in ROOMS[room].tests]
    command = [sys.executable, "-B", "-m", "pytest", "-qx", "-p", "no:cacheprovider", "--shared", shared, *tests]
    paths = os.pathsep.join(str(folder / part) for part in ("src", "tools"))
    surroundings = {**os.environ, "PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        done = subprocess.run(
            command, cwd=folder, env=surroundings, timeout=limit_s, check=False, capture_output=True, text=True
        )
    except subprocess.TimeoutExpired:
        return False
    if limit_s is None and done.returncode:
        raise SystemExit(f"the tests of {room} fail without a mistake:\n{done.stdout[-2000:]}")
    return not done.returncode


def survives(folder: Path, mutant: Mutant, limit_s: float) -> bool:
    """Whether no test notices a mistake."""
    path = folder / mutant.path
    text = path.read_text()
    path.write_text(mutant.mutation.of(text))
    try:
        return passed(folder, mutant.room, limit_s)
    finally:
        path.write_text(text)


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="accuracy mutants", description=__doc__)
    parser.add_argument("--rooms", nargs="*", choices=ROOMS, default=list(ROOMS))
    parser.add_argument("--each", type=int, default=12, help="mistakes of each room")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    noticed: dict[str, list[bool]] = {room: [] for room in asked.rooms}
    with TemporaryDirectory() as name:
        copied(Path(name))
        limits = {}
        for room in asked.rooms:
            begun = time.monotonic()
            passed(Path(name), room)
            limits[room] = LEAST_S + PATIENCE * (time.monotonic() - begun)
        for mutant in drawn(asked.rooms, asked.each, asked.seed):
            alive = survives(Path(name), mutant, limits[mutant.room])
            noticed[mutant.room].append(not alive)
            print(f"{'NOT NOTICED' if alive else 'noticed'}: {mutant.told()}", flush=True)
    print_scores(noticed)
    if asked.json:
        asked.json.write_text(json.dumps({k: sum(v) / len(v) for k, v in noticed.items()}, indent=1) + "\n")
    return 0


def print_scores(noticed: dict[str, list[bool]]) -> None:
    """A table by room."""
    shown = Table(title="mistakes that the tests notice")
    for title in ("room", "mistakes", "noticed", "share"):
        shown.add_column(title, justify="left" if title == "room" else "right")
    every = [found for each in noticed.values() for found in each]
    for room, each in [*noticed.items(), ("all", every)]:
        shown.add_row(room, str(len(each)), str(sum(each)), f"{100.0 * sum(each) / max(len(each), 1):.0f} %")
    Console().print(shown)


if __name__ == "__main__":
    sys.exit(main())
