"""The command line explains itself: quickly, in the order of a user's day, with an example that works, in the shell."""

import os
import shlex
import subprocess
import sys

import pytest
import typer

from cylforce.programs.cli import app
from speed import processor_s, takes_at_most

DAY = [
    "new",
    "describe",
    "commission",
    "identify",
    "seal",
    "run",
    "display",
    "scale",
    "replay",
    "gap",
    "checkup",
    "fleet",
    "sim",
    "demo",
    "records",
    "config",
]
# The promise to the user, of a computer that imports numpy in 0.1 s. `--version` and `--help` take 0.08 s of processor
# time, `run --help` 0.18 s (typer then loads pydantic), of which Python alone 0.03 s.
LONGEST_S = 0.3
HEAVY = ("numpy", "scipy", "structlog", "can", "canopen", "tomlkit")


def cylforce_(*words, **variables):
    command = [sys.executable, "-m", "cylforce", *words]
    return subprocess.run(command, capture_output=True, text=True, env=os.environ | variables, timeout=60)


@pytest.mark.parametrize("words", [["--version"], ["--help"], ["run", "--help"]])
def test_the_answer_comes_at_once(words):
    assert takes_at_most(LONGEST_S, lambda: processor_s("-m", "cylforce", *words))


@pytest.mark.parametrize("words", [["--version"], ["--help"], ["run", "--help"], ["config", "copy", "--help"]])
def test_help_loads_nothing_heavy(words):
    """This does not depend on the machine."""
    command = [sys.executable, "-X", "importtime", "-m", "cylforce", *words]
    loaded = subprocess.run(command, capture_output=True, text=True, check=True).stderr
    names = {line.rpartition("|")[2].strip().split(".")[0] for line in loaded.splitlines()}
    assert "typer" in names
    assert names.isdisjoint(HEAVY)


def commands(group=None, path=()):
    """Every command that does something, with the words that lead to it."""
    group = typer.main.get_command(app) if group is None else group
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, (*path, name))
        else:
            yield (*path, name), command


def test_commands_are_listed_in_the_order_of_a_day():
    """Each on one line, nothing cut off."""
    out = cylforce_("--help", COLUMNS="80").stdout
    lines = [line.strip() for line in out.partition("Commands:")[2].splitlines() if line.strip()]
    listed = [line.split()[0] for line in lines]
    assert [name for name in DAY if name in listed] == listed
    assert not any(line.endswith("...") for line in lines)


@pytest.mark.parametrize(("path", "command"), list(commands()), ids=[" ".join(path) for path, _ in commands()])
def test_help_has_an_example_that_the_command_accepts(path, command):
    """The example at the end of the help is shown whole, and its words are options and arguments of this command."""
    assert command.epilog.startswith("Example: cylforce ")
    shown = " ".join(cylforce_(*path, "--help", COLUMNS="80").stdout.split())
    assert shown.endswith(command.epilog)
    words = shlex.split(command.epilog.removeprefix("Example: cylforce "))
    assert tuple(words[: len(path)]) == path
    command.make_context(path[-1], words[len(path) :])


def test_every_option_is_explained():
    """No option or argument whose help is empty, but for the metavariable that says it all."""
    silent = [
        f"{' '.join(path)} {p.name}" for path, c in commands() for p in c.params if not p.help and p.name != "files"
    ]
    assert silent == []


def test_the_shell_completes_commands_and_names():
    """As bash asks for it."""
    found = cylforce_(_CYLFORCE_COMPLETE="complete_bash", COMP_WORDS="cylforce re", COMP_CWORD="1")
    assert found.stdout.split() == ["replay", "records"]
    words = "cylforce config copy excavator_2"
    found = cylforce_(_CYLFORCE_COMPLETE="complete_bash", COMP_WORDS=words, COMP_CWORD="3")
    assert found.stdout.split() == ["excavator_20t.toml"]
    assert "--install-completion" in cylforce_("--help").stdout
