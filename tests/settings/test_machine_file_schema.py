"""The JSON schema of the machine file accepts what is in order and finds what an editor can find."""

import tomllib

import jsonschema
import pytest

from cylforce.settings.schema import machine_file_schema
from scenarios import CONFIG, EXCAVATOR

SCHEMA = machine_file_schema()
CHECK = jsonschema.Draft202012Validator(SCHEMA)
SHIPPED = EXCAVATOR.read_text()


def test_it_is_a_schema():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)


@pytest.mark.parametrize("path", sorted(CONFIG.glob("*.toml")), ids=lambda path: path.stem)
def test_shipped_files_are_valid(path):
    assert [error.message for error in CHECK.iter_errors(tomllib.loads(path.read_text()))] == []


def test_foreign_files_are_valid(shared):
    for path in (shared / "data/foreign_machines").glob("*/machine.toml"):
        assert [error.message for error in CHECK.iter_errors(tomllib.loads(path.read_text()))] == []


@pytest.mark.parametrize(
    ("old", "new", "at"),
    [
        ("mass_kg = 1700", "mas_kg = 1700", "$.links[0]"),
        ("length_m = 5.7", "length_m = 5700", "$.links[0].length_m"),
        ('side = "left"', 'side = "above"', "$.cylinders[2].linkage"),
        ("range_bar = [-5, 400]", "range_deg = [-5, 400]", "$.sensors[0]"),
        ("range_bar = [-5, 400]\n", "", "$.sensors[0]"),
        ('kind = "roll"', 'kind = "rol"', "$.sensors[10].kind"),
        ("rate_hz = 100", "rate_hz = 0", "$.filter.rate_hz"),
        ('object = "7130h:1"', "object = 0x7130", "$.sensors[0].object"),
        ("[tool]", "[tol]", "$"),
    ],
)
def test_what_an_editor_can_find_is_found_at_its_place(old, new, at):
    assert old in SHIPPED
    found = [error.json_path for error in CHECK.iter_errors(tomllib.loads(SHIPPED.replace(old, new, 1)))]
    assert at in found


def test_columns_of_recordings_have_their_units():
    text = SHIPPED + '\n[table]\ntime = { column = "t", scale_ms = 1 }\n[table.signals]\npitch = { column = "p", '
    assert CHECK.is_valid(tomllib.loads(text + "scale_deg = 1 }"))
    assert not CHECK.is_valid(tomllib.loads(text + "scale = 1 }"))
