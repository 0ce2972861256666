"""Motions as tables (CSV): joint angles over time, which a simulator or a test rig can play.

    # move the boom alone, slowly, from end to end and back
    # load: an empty bucket
    t_s,boom_rad,stick_rad,bucket_rad,slew_rad
    0.00,0.7123,-1.2000,-0.8000,0.0000

A column per joint has its angle [rad] as the machine file counts it, against the link before. The angle of the house is
zero where its column is absent."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import isfinite
from pathlib import Path

import numpy as np

from cylforce.files.atomic import RecordingError, replacing
from cylforce.files.text_file import read_text
from cylforce.signals.estimate import Array

TIME, SUFFIX, SLEW = "t_s", "_rad", "slew"
EXAMPLE = "write one with `cylforce gap ... --next-motion motion.csv`"


@dataclass(frozen=True)
class MotionTable:
    """A motion.

    t_s:      (T,) time [s], increasing, from 0
    angles:   (T, N) joint angles [rad]
    slew:     (T,) angle of the house [rad]
    lines:    (T,) line of each row in its file; empty if it was not read
    comments: lines of text about the motion, without the `#`
    """

    t_s: Array
    angles: Array
    slew: Array
    lines: tuple[int, ...] = ()
    comments: tuple[str, ...] = ()


def write_motion(path: Path, table: MotionTable, joints: Sequence[str]) -> None:
    """Write a motion, times to 1 ms, angles to 1e-6 rad. Raises RecordingError when the disk refuses.

    After the comments come the header t_s, JOINT_rad, ..., slew_rad and a row for each time.

    joints: (N,) names of the joints
    """
    header = [TIME, *(f"{name}{SUFFIX}" for name in joints), f"{SLEW}{SUFFIX}"]
    rows = np.column_stack([table.t_s, table.angles, table.slew])
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as file:
        file.writelines(f"# {comment}\n" for comment in table.comments)
        file.write(",".join(header) + "\n")
        file.writelines(f"{row[0]:.3f},{','.join(f'{x:.6f}' for x in row[1:])}\n" for row in rows.tolist())


def read_motion(path: Path, joints: Sequence[str]) -> MotionTable:
    """Read a motion of a machine with joints of these names. Raises RecordingError with file, line and cure.

    The columns may be in any order. The result counts the time from 0.

    joints: (N,) names of the joints
    """
    header, rows, lines, comments = None, list[list[float]](), list[int](), list[str]()
    for number, line in enumerate(read_text(path, EXAMPLE).splitlines(), 1):
        text = line.strip()
        if text.startswith("#"):
            comments.append(text[1:].strip())
        elif text and header is None:
            header = _columns(path, number, text, joints)
        elif text and header is not None:
            rows.append(_numbers(path, number, text, header))
            lines.append(number)
    if header is None or len(rows) < 2:
        raise RecordingError(f"{path}: has no motion, which is a header and two rows or more: {EXAMPLE}")
    values = np.array(rows)
    t_s = values[:, header.index(TIME)]
    for (before, now), line_number in zip(pairwise(t_s.tolist()), lines[1:], strict=True):
        if now <= before:
            raise RecordingError(
                f"{path}:{line_number}: {TIME} goes from {before:g} to {now:g}: time must increase from row to row"
            )
    names = [f"{name}{SUFFIX}" for name in joints]
    slew = values[:, header.index(f"{SLEW}{SUFFIX}")] if f"{SLEW}{SUFFIX}" in header else np.zeros(len(values))
    angles = values[:, [header.index(name) for name in names]]
    return MotionTable(t_s - t_s[0], angles, slew, tuple(lines), tuple(comments))


def _columns(path: Path, line: int, text: str, joints: Sequence[str]) -> list[str]:
    """Return the names of the columns in a header.

    Raises RecordingError for a column that is unknown or there twice, or where the time or a joint is missing.

    line: number of the header's line
    text: the line
    joints: (N,) names of the joints
    """
    found = [cell.strip() for cell in text.split(",")]
    wanted = [TIME, *(f"{name}{SUFFIX}" for name in joints)]
    known = ", ".join([*wanted, f"{SLEW}{SUFFIX}"])
    if unknown := [name for name in found if name not in (*wanted, f"{SLEW}{SUFFIX}")]:
        raise RecordingError(f"{path}:{line}: column {unknown[0]!r} is no joint of this machine: use {known}")
    if missing := [name for name in wanted if name not in found]:
        raise RecordingError(f"{path}:{line}: has no column {missing[0]!r}: give {known}")
    if twice := [name for name in found if found.count(name) > 1]:
        raise RecordingError(f"{path}:{line}: column {twice[0]!r} is there twice: give it once")
    return found


def _numbers(path: Path, line: int, text: str, header: list[str]) -> list[float]:
    """Return the numbers of a row, in the units of its columns. Raises RecordingError, with the number of its line.

    line: number of the line
    text: the line
    header: names of the columns
    """
    cells = text.split(",")
    if len(cells) != len(header):
        raise RecordingError(f"{path}:{line}: has {len(cells)} cells, the header {len(header)}: give one a column")
    found = []
    for name, cell in zip(header, cells, strict=True):
        try:
            value = float(cell)
        except ValueError:
            value = float("nan")
        if not isfinite(value):
            raise RecordingError(f"{path}:{line}: {cell.strip()!r} in column {name!r} is no number: give it as 0.25")
        found.append(value)
    return found
