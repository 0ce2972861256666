"""Tables on a terminal of 80 columns, or on a pipe: names and numbers stay whole."""

import io

import pytest
from rich.console import Console
from rich.progress import Progress

from cylforce.effects.library import proposals
from cylforce.programs.common.progress import over_all
from cylforce.programs.common.tables import fitting, print_table
from cylforce.programs.gap_output import show_effects
from cylforce.settings.machine_file import load
from scenarios import CONFIG

MACHINES = sorted(CONFIG.glob("*.toml"))


def shown(width, show):
    """What is printed on a console so wide, terminal or pipe."""
    stream = io.StringIO()
    show(Console(file=stream, width=width, highlight=False))
    return stream.getvalue()


def effect(name, at):
    size = {"value": -0.0123456, "low": -951.234, "high": -0.0000931, "unit": "N m s/rad"}
    return {"name": name, "at": at, "parameters": {"size": size}, "confidence": 0.98}


@pytest.mark.parametrize("path", MACHINES, ids=lambda path: path.stem)
def test_every_effect_at_every_place_is_shown_whole(path):
    """All effects of the library at all their places; each line fits into 80 columns."""
    pairs = sorted({(p.name, p.at) for p in proposals(load(path).service.machine)})
    assert max(len(name) for name, _ in pairs) > 20
    for name, at in pairs:
        text = shown(80, lambda console, name=name, at=at: show_effects([effect(name, at)], console))
        assert {f"{name}@{at}", "-0.01235", "files"} <= set(text.split())
        assert "…" not in text
        assert max(map(len, text.splitlines())) <= 80


def test_a_console_too_narrow_gets_a_wider_table():
    text = shown(30, lambda console: show_effects([effect("linkage_geometry", "bucket")], console))
    assert {"linkage_geometry@bucket", "files", "-0.01235"} <= set(text.split())


def test_the_consoles_width_is_given_back():
    console = Console(file=io.StringIO(), width=10)
    print_table(console, ["much too wide for it"], [["extraordinarily"]], [])
    assert console.width == 10


@pytest.mark.parametrize(
    ("room", "widths"),
    [(100, [11, 5, 11]), (26, [10, 5, 11]), (21, [5, 5, 11]), (18, [5, 5, 8]), (13, [5, 5, 3]), (1, [5, 5, 3])],
)
def test_headers_are_wrapped_before_cells(room, widths):
    """Longest words 5, 5 and 3 characters long; the first column's header and the third one's cell have several."""
    columns = [["alpha gamma", "x"], ["d", "delta"], ["one", "one two six"]]
    assert fitting(columns, room) == widths


def test_the_bar_counts_whole_steps():
    """Three things are done, the second of them twice told; more than promised never exceed the bar."""
    with Progress(disable=True) as bar:
        watch, seen = over_all(bar, 3), []
        for doing, share in (("reading", None), ("reading", 0.5), ("fitting", None), ("drawing", 1.0), ("more", None)):
            watch(doing, share)
            seen.append((bar.tasks[0].description, bar.tasks[0].completed))
    assert seen == [
        ("1/3 reading", 0.0),
        ("1/3 reading", 0.5),
        ("2/3 fitting", 1.0),
        ("3/3 drawing", 3.0),
        ("3/3 more", 3.0),
    ]
