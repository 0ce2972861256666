"""config/README.md: its table of keys is that of the models, its example is what a broken file brings."""

import re

import pytest

import machine_file_keys
from cylforce.settings.machine_file import SettingsError, load
from cylforce.settings.schema import machine_file_schema
from scenarios import CONFIG, EXCAVATOR

PAGE = (CONFIG / "README.md").read_text()


def test_the_table_of_keys_is_up_to_date():
    """If it is not: tools/machine_file_keys writes it anew."""
    assert machine_file_keys.page(PAGE) == PAGE


def test_the_page_is_short():
    assert len(PAGE.splitlines()) <= 200


def test_every_key_has_a_meaning_of_its_own():
    schema = machine_file_schema()
    for name, table in schema["$defs"].items():
        for key, of_key in table.get("properties", {}).items():
            assert of_key.get("description") or "$ref" in of_key, (name, key)


def test_every_key_of_the_shipped_files_is_in_the_table():
    rows = {row.split(".")[-1] for row in re.findall(r"^\| `([\w.]+)` ", PAGE, re.MULTILINE)}
    for path in CONFIG.glob("*.toml"):
        for key in re.findall(r"^(\w+) = ", path.read_text(), re.MULTILINE):
            united = re.sub(r"^(scale|offset|range|standard_error)_.*", r"\1_UNIT", key)
            assert united in rows, key


def test_the_example_of_the_page_is_what_such_a_file_brings(tmp_path):
    text = EXCAVATOR.read_text()
    for old, new in (("mass_kg = 1700", "mas_kg = 1700"), ("node_id = 34", "node_id = 33")):
        text = text.replace(old, new, 1)
    (tmp_path / "machine.toml").write_text(text)
    with pytest.raises(SettingsError) as error:
        load(tmp_path / "machine.toml")
    assert str(error.value).replace(f"{tmp_path}/", "") in PAGE


def test_a_page_without_markers_is_refused():
    with pytest.raises(ValueError, match="lacks the markers"):
        machine_file_keys.page("# The machine file\n")
