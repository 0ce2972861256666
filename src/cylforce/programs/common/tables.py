"""Tables on a terminal whose words and numbers stay whole however narrow it is."""

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

BORDER = 3  # characters that a column needs beside its cells; one more closes the table


def print_table(
    console: Console, header: Sequence[str], rows: Sequence[Sequence[str]], right: Sequence[str], title: str = ""
) -> None:
    """Print a table that wraps its cells at spaces only; the columns named in `right` are aligned there. Where its
    longest words do not fit, it is wider than the console."""
    columns = list(zip(header, *rows, strict=True))
    widths = fitting(columns, console.width - BORDER * len(columns) - 1)
    table = Table(title=title or None)
    for name, width in zip(header, widths, strict=True):
        table.add_column(name, justify="right" if name in right else "left", width=width)
    for row in rows:
        table.add_row(*row)
    shown = console.width
    console.width = max(shown, sum(widths) + BORDER * len(widths) + 1)
    console.print(table)
    console.width = shown


def fitting(columns: Sequence[Sequence[str]], room: int) -> list[int]:
    """Return the widths of columns, each a header and its cells, that fit into `room` together.

    Headers are wrapped first, then cells. The width is reduced in the column that is farthest above its longest word.
    """
    widths = [max(map(len, cells)) for cells in columns]
    for least in ([max(_longest(head), *map(len, cells)) for head, *cells in columns], list(map(_word, columns))):
        while sum(widths) > room and widths != least:
            spare = [width - word for width, word in zip(widths, least, strict=True)]
            widths[spare.index(max(spare))] -= 1
    return widths


def _longest(text: str) -> int:
    """Return the length of the longest word of a text."""
    return max(map(len, text.split()), default=0)


def _word(cells: Sequence[str]) -> int:
    return max(map(_longest, cells))
