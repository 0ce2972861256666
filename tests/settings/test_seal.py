"""The seal of identified.toml: what was edited is named; a change on purpose is sealed anew, with its reason."""

import getpass
import re
import tomllib
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from types import SimpleNamespace

import numpy as np
import pytest
import tomlkit

from command_line import cylforce_
from cylforce.commissioning.identification import Identification
from cylforce.files.software import controller_id
from cylforce.programs.common.readings import model_of
from cylforce.programs.live.books import kept_by
from cylforce.settings.identified import identified_seal, read_identified, seal_again, write_identified
from cylforce.settings.machine_file import SettingsError, load
from cylforce.settings.seal import Seal, broken, sealed
from scenarios import EXCAVATOR

MACHINE = load(EXCAVATOR)


@pytest.fixture
def file(tmp_path):
    """A file as `cylforce identify` writes it, of the data sheet's values."""
    model = model_of(MACHINE)
    sheet = model.data_sheet
    tares = sheet._replace(covariance=1e-6 * sheet.covariance, identified=True, row_error=np.full(3, 60.0))
    found = Identification(model, tares, None, (), 60.0, {}, (), np.ones(3), ())
    path = tmp_path / "identified.toml"
    write_identified(path, found, MACHINE, [("empty.log", "0" * 64)])
    return path


def edit(path, change):
    said = tomlkit.parse(path.read_text())
    change(said)
    path.write_text(tomlkit.dumps(said))


def seal(path, *words):
    """Exit code and output of the command, in this process."""
    out, err = StringIO(), StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = cylforce_("seal", EXCAVATOR, path, *words)
    return SimpleNamespace(returncode=code, stdout=out.getvalue(), stderr=err.getvalue())


def scaled(said):
    said["scale"] = 1.2


def negative_friction(said):
    place = next(p for p in said["parameters"] if p["name"].endswith("coulomb"))
    place["value"] = -abs(place["value"])


def more_certain(said):
    said["covariance"] = [[0.5 * float(x) for x in row] for row in said["covariance"]]


def no_seal(said):
    del said["seal"]


def no_warnings(said):
    said["warnings"] = ["nothing"]


def other_reason(said):
    said["seal"]["reason"] = "approved"


EDITS = [
    (scaled, "scale"),
    (negative_friction, "parameters"),
    (more_certain, "covariance"),
    (no_warnings, "warnings"),
    (no_seal, "seal"),
    (other_reason, "seal"),
]


def test_a_file_as_it_was_written_is_read(file):
    assert read_identified(file, MACHINE).identified
    made = identified_seal(file)
    assert (made.counter, made.before, made.reason, made.who) == (1, "", "identified", getpass.getuser())


@pytest.mark.parametrize(("change", "key"), EDITS)
def test_an_edited_file_is_refused_by_key_with_the_cure(file, change, key):
    edit(file, change)
    with pytest.raises(SettingsError, match=rf"identified\.toml: {key}: not as sealed") as caught:
        read_identified(file, MACHINE)
    assert "identify again, or accept it on purpose: cylforce seal" in str(caught.value)


def test_blanks_comments_and_the_order_of_keys_change_nothing(file):
    said = tomllib.loads(file.read_text())
    file.write_text("# written anew\n" + tomlkit.dumps(dict(sorted(said.items(), key=lambda item: item[0] != "scale"))))
    assert read_identified(file, MACHINE).identified


@pytest.mark.parametrize("change", [scaled, no_seal])
def test_a_change_on_purpose_is_sealed_with_who_and_why(file, change):
    before = identified_seal(file)
    edit(file, change)
    done = seal(file, "--reason", "test weight 12")
    assert done.returncode == 0, done.stderr
    assert f"changed since it was sealed: {'scale' if change is scaled else 'seal'}" in done.stdout
    made = identified_seal(file)
    assert (made.reason, made.who) == ("test weight 12", getpass.getuser())
    assert (made.counter, made.before) == ((2, before.sha256) if change is scaled else (1, ""))
    assert read_identified(file, MACHINE).scale == (1.2 if change is scaled else 1.0)


def test_no_reason_no_seal(file):
    edit(file, scaled)
    text = file.read_text()
    assert seal(file, "--reason", "  ").returncode == 2
    assert seal(file).returncode == 2
    assert file.read_text() == text


def test_what_could_not_be_used_anyway_is_not_sealed(file):
    edit(file, lambda said: said.update(scale=3.0))
    done = seal(file, "--reason", "try")
    assert (done.returncode, "scale: 3 is outside" in done.stderr) == (2, True)


def test_a_file_from_before_seals_can_be_sealed(file):
    def older(said):
        del said["seal"]
        said["provenance"]["format"] = 1

    edit(file, older)
    with pytest.raises(
        SettingsError, match=r"is of format 1, this version reads 2; identify again, or `cylforce seal`"
    ):
        read_identified(file, MACHINE)
    assert seal(file, "--reason", "from before 1.0").returncode == 0
    assert read_identified(file, MACHINE).identified


def test_every_flipped_character_of_a_seal_breaks_it():
    content = {"a": 1.5, "b": ["x"]}
    made = sealed(content, None, "2026-01-01", "why", "who")
    assert broken(content, made) == ()
    for key, value in made.model_dump().items():
        other = {"counter": 2, "keys": {**made.keys, "a": "0" * 64}}.get(key, f"{value}x")
        assert broken(content, Seal.model_validate(made.model_dump() | {key: other})) == ("seal",)
    assert broken({**content, "c": 0}, made) == ("c",)
    assert broken({"a": 1.5}, made) == ("b",)


def test_a_file_of_another_controller_is_told_until_it_is_sealed_here(file):
    def sealed_elsewhere(said):
        content = {key: value for key, value in said.unwrap().items() if key != "seal"}
        said["seal"] = sealed(content, None, "2026-01-01", "why", "who", "another").model_dump()

    assert not kept_by(None, file).unconfirmed
    edit(file, sealed_elsewhere)
    assert read_identified(file, MACHINE).identified
    assert kept_by(None, file).unconfirmed
    assert not kept_by(None, None).unconfirmed  # of the data sheet
    seal_again(file, MACHINE, "copied from the laptop")
    assert read_identified(file, MACHINE).identified
    assert not kept_by(None, file).unconfirmed


def test_a_controller_is_known_by_a_hash_of_its_machine_id(tmp_path):
    """The machine id itself does not leave the computer."""
    path, ids = tmp_path / "machine-id", ("0123456789abcdef0123456789abcdef", "0123456789abcdef0123456789abcdee")
    assert controller_id(path) == ""
    found = []
    for text in ids:
        path.write_text(f"{text}\n")
        found.append(controller_id(path))
    assert len(set(found)) == 2
    assert all(re.fullmatch("[0-9a-f]{16}", each) and each not in text for each, text in zip(found, ids, strict=True))


def test_a_seal_from_before_controllers_is_whole():
    content = {"a": 1.5}
    made = sealed(content, None, "2026-01-01", "why", "who")
    older = {key: value for key, value in made.model_dump().items() if key != "controller"}
    assert broken(content, Seal.model_validate(older)) == ()
    assert older["sha256"] == "78f1722241612a1ea6c95cd3f34ab80f9a5d7fcf146d9078cec68094ca254720"  # as it was made then
