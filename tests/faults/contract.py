"""The fault contract: what the service does about every fault, and which tests show it. README.md beside this file is
written from contract.csv and attacks.csv: `python tests/faults/contract.py`."""

import csv
from pathlib import Path
from typing import NamedTuple

HERE = Path(__file__).parent
README = HERE / "README.md"
FAULTS = 50  # in the list of faults that a service must survive
HEAD = f"""# Fault contract

What the service does about each fault of the list of {FAULTS}, and the tests that show it, relative to `tests/`.
Written by `python tests/faults/contract.py` from `contract.csv` and `attacks.csv`; a test checks that this page is
what that writes, and that every test named here exists. T is the period of the loop, 10 ms.

| # | fault | noticed within | output | EMCY | over | shown by |
|---|---|---|---|---|---|---|
"""
ATTACKS_HEAD = """
## What was done to an earlier service from outside

| what was done | what happened then | what happens now | shown by |
|---|---|---|---|
"""


class Row(NamedTuple):
    """A fault. `shown`: tests as file::test, relative to tests/."""

    number: int
    fault: str
    within: str
    output: str
    emcy: str
    over: str
    shown: tuple[str, ...]


class Attack(NamedTuple):
    """Something that was done to an earlier service: what happened then and now. `shown` as in Row."""

    done: str
    before: str
    now: str
    shown: tuple[str, ...]


def _read(name: str) -> list[list[str]]:
    with (HERE / name).open(newline="", encoding="utf-8") as file:
        return list(csv.reader(file))[1:]


def rows() -> list[Row]:
    """The contract."""
    return [Row(int(number), *words, tuple(shown.split())) for number, *words, shown in _read("contract.csv")]


def attacks() -> list[Attack]:
    """What was done from outside."""
    return [Attack(*words, tuple(shown.split())) for *words, shown in _read("attacks.csv")]


def _line(*words: str, shown: tuple[str, ...]) -> str:
    return f"| {' | '.join(words)} | {', '.join(f'`{test}`' for test in shown)} |\n"


def page() -> str:
    """The page."""
    contract = rows()
    lines = [_line(str(row.number), *row[1:6], shown=row.shown) for row in contract]
    known = {row.number for row in contract}
    without = ", ".join(str(k) for k in range(1, FAULTS + 1) if k not in known)
    rest = f"\nWithout a row here, so without a test in this table: {without}.\n" if without else ""
    done = [_line(*attack[:3], shown=attack.shown) for attack in attacks()]
    return "".join([HEAD, *lines, rest, ATTACKS_HEAD, *done])


if __name__ == "__main__":
    README.write_text(page(), encoding="utf-8")
