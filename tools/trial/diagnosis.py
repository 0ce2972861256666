"""Runs `cylforce gap` on a case in a process that has nothing but the case's folder."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

COMMAND = (sys.executable, "-m", "cylforce", "gap")
KEPT = ("PATH", "HOME", "LANG", "PYTHONPATH", "VIRTUAL_ENV", "XDG_CACHE_HOME")
LIMIT_S = 900


@dataclass(frozen=True)
class Diagnosis:
    """A command that takes a case's arguments; another command than `cylforce gap` for tests and for comparison."""

    command: tuple[str, ...] = COMMAND

    @cached_property
    def options(self) -> str:
        """Its help text: some options are only used where it has them."""
        done = subprocess.run(
            [*self.command, "--help"], env=_environment(), capture_output=True, text=True, check=False
        )
        return done.stdout

    def answer(self, folder: Path, more: tuple[str, ...] = ()) -> dict[str, Any]:
        """Its JSON, with `seconds`; a failure is the verdict "failed" with the reason."""
        out = folder / "out.json"
        out.unlink(missing_ok=True)
        given = [*self.command, *arguments(folder), "--json", out.name, *more]
        if "--residuals" in self.options and not more:
            given += ["--residuals", "residuals.npz"]
        start = time.monotonic()
        try:
            done = subprocess.run(
                given, cwd=folder, env=_environment(), capture_output=True, text=True, timeout=LIMIT_S, check=False
            )
            reason = done.stderr.strip()[-400:]
        except subprocess.TimeoutExpired:
            reason = f"no answer within {LIMIT_S} s"
        if not out.exists():
            return {"verdict": "failed", "effects": [], "reason": reason, "seconds": time.monotonic() - start}
        answer: dict[str, Any] = json.loads(out.read_text())
        return answer | {"seconds": time.monotonic() - start}

    def left_out(self, folder: Path, names: Sequence[str]) -> dict[str, Any] | None:
        """The answer where the library lacks effects; None from a diagnosis that cannot be asked so."""
        if "--without" not in self.options:
            return None
        return self.answer(folder, tuple(word for name in names for word in ("--without", name)))


def _environment() -> dict[str, str]:
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    return {key: os.environ[key] for key in KEPT if key in os.environ} | threads


def arguments(folder: Path) -> list[str]:
    """The command line of a case, relative to its folder; tares where case.json names them."""
    case = json.loads((folder / "case.json").read_text())
    found = ["machine.toml", *case["field"]]
    for name in case["reference"]:
        found += ["--reference", name]
    if "identified" in case:
        found += ["--identified", case["identified"]]
    for name, kilograms in case["loads_kg"].items():
        found += ["--load", f"{name}={kilograms:g}"]
    return found
