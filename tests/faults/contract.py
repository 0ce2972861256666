"""The fault contract: what the service does about every fault, and which tests show it. README.md beside this file is
written from contract.csv: `python tests/faults/contract.py`."""

import csv
from pathlib import Path
from typing import NamedTuple

HERE = Path(__file__).parent
README = HERE / "README.md"
FAULTS = 50  # in the list of faults that a service must survive
HEAD = f"""# Fault contract

What the service does about each fault of the list of {FAULTS}, and the tests that show it, relative to `tests/`.
Written by `python tests/faults/contract.py` from `contract.csv`; a test checks that this page is what that writes, and
that every test named here exists. T is the period of the loop, 10 ms.

| # | fault | noticed within | output | EMCY | over | shown by |
|---|---|---|---|---|---|---|
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


def rows() -> list[Row]:
    """The contract."""
    with (HERE / "contract.csv").open(newline="", encoding="utf-8") as file:
        return [Row(int(number), *words, tuple(shown.split())) for number, *words, shown in list(csv.reader(file))[1:]]


def page() -> str:
    """The page."""
    contract = rows()
    lines = []
    for row in contract:
        shown = ", ".join(f"`{test}`" for test in row.shown)
        lines.append(f"| {' | '.join((str(row.number), *row[1:6]))} | {shown} |\n")
    known = {row.number for row in contract}
    without = ", ".join(str(k) for k in range(1, FAULTS + 1) if k not in known)
    rest = f"\nWithout a row here, so without a test in this table: {without}.\n" if without else ""
    return HEAD + "".join(lines) + rest


if __name__ == "__main__":
    README.write_text(page(), encoding="utf-8")
