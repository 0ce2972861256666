"""Values of which a step makes many: mypy keeps them immutable, equal values are equal."""

import subprocess
import sys
from dataclasses import fields, replace

import pytest

from cylforce.signals.estimate import Estimate, Force, Load, Quantity, Reason, Sample, Status

ASSIGNED = """
from cylforce.signals.estimate import Quantity, Reason, Status
quantity = Quantity(1.0, 0.5, Status.OK, Reason.NONE)
quantity.value = 2.0
"""


def test_mypy_reports_an_assignment(tmp_path):
    path = tmp_path / "assigned.py"
    path.write_text(ASSIGNED)
    words = [sys.executable, "-m", "mypy", "--cache-dir", str(tmp_path / "cache"), "--follow-imports", "silent"]
    done = subprocess.run([*words, str(path)], capture_output=True, text=True, timeout=300)
    assert 'assigned.py:4: error: Property "value" defined in "Quantity" is read-only' in done.stdout
    assert "Found 1 error" in done.stdout


def test_equal_values_are_equal_and_have_one_hash():
    one = Quantity(1.0, 0.5, Status.OK, Reason.NONE)
    assert one == replace(one)
    assert len({one, replace(one), replace(one, value=2.0)}) == 2


@pytest.mark.parametrize("kind", [Estimate, Force, Load, Quantity, Sample])
def test_a_value_has_no_other_attributes_than_its_fields(kind):
    made = kind(*[None] * len(fields(kind)))
    with pytest.raises(AttributeError):
        made.other = 1.0
