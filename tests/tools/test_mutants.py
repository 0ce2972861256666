"""Mistakes that are put into a text, and whether the tests' failure is taken for a mistake that was noticed."""

import pytest

from mutants.__main__ import ROOMS, ROOT, SOURCE, drawn
from mutants.changes import mutations

TEXT = '''"""A room."""
from math import pi

LIMIT = 2.0


def larger(a: int, b: "int | None" = None) -> bool:
    """Whether it is."""
    if not a:
        raise ValueError("1 < 2")
    print(a)
    return a + 1 < LIMIT and b is not None
'''


def put(text):
    return {mutation.of(text) for mutation in mutations(text)}


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("LIMIT = 2.0", "LIMIT = 4.0"),
        ("if not a:", "if (a):"),
        ("    print(a)\n", "    pass\n"),
        ("a + 1 <", "(a - 1) <"),
        ("a + 1 <", "a + 2 <"),
        ("a + 1 < LIMIT", "(a + 1 >= LIMIT)"),
        ("a + 1 < LIMIT", "(a + 1 <= LIMIT)"),
        ("b is not None\n", "(b is None)\n"),
        ("a + 1 < LIMIT and b is not None", "(a + 1 < LIMIT or b is not None)"),
    ],
)
def test_each_mistake_is_one_change_of_the_text(before, after):
    assert TEXT.replace(before, after) in put(TEXT)


def test_no_more_mistakes_than_these():
    """None in annotations, messages, imports and docstrings."""
    assert len(put(TEXT)) == 9


def test_every_mistake_is_a_text_of_python_and_another_one():
    for room in ROOMS.values():
        for path in (p for pattern in room.files for p in (ROOT / SOURCE).glob(pattern)):
            text = path.read_text()
            for mutation in mutations(text):
                assert mutation.of(text) != text
        assert all((ROOT / "tests" / name).is_file() for name in room.tests)
    compile(next(mutations(text)).of(text), "text", "exec")


def test_a_seed_is_a_choice_of_mistakes():
    assert drawn(["codec"], 5, 1) == drawn(["codec"], 5, 1) != drawn(["codec"], 5, 2)
    assert {mutant.room for mutant in drawn(["codec", "gates"], 5, 1)} == {"codec", "gates"}
