"""What runs on a controller: its bill of materials, licences, and vulnerabilities out of a file."""

import json
from zipfile import ZipFile

import pytest

import supply
from supply import Component, advisories, affects, bill, components, is_allowed, locked, main, vulnerable

LOCK = locked((supply.ROOT / "requirements.lock").read_text())


@pytest.fixture(scope="module")
def found():
    return components(LOCK)


def test_the_bill_has_what_a_controller_needs_in_the_versions_of_the_lock_and_no_tests(found):
    names = {c.name for c in found}
    assert found[0].name == "cylforce"
    assert {"numpy", "scipy", "canopen", "python-can", "pydantic-core", "paho-mqtt", "h11"} <= names
    assert not names & {"pytest", "mypy", "ruff", "hypothesis", "mujoco", "playwright"}
    assert all(LOCK[c.name] == c.version for c in found[1:])


def test_every_dependency_of_the_bill_is_a_component_of_it(found):
    made = bill(found)
    refs = {made["metadata"]["component"]["bom-ref"], *(c["bom-ref"] for c in made["components"])}
    assert len(refs) == len(found)
    assert {d["ref"] for d in made["dependencies"]} == refs
    assert all(set(d["dependsOn"]) <= refs for d in made["dependencies"])
    assert {c["purl"].partition("@")[0] for c in made["components"]} >= {"pkg:pypi/numpy", "pkg:pypi/python-can"}


def test_the_same_packages_give_the_same_bytes_and_others_another_number(found, tmp_path):
    for name in ("a.json", "b.json"):
        assert main(["sbom", "-o", str(tmp_path / name)]) == 0
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()
    said = json.loads((tmp_path / "a.json").read_text())
    assert (said["bomFormat"], said["specVersion"], said["version"]) == ("CycloneDX", "1.6", 1)
    other = bill([*found[:-1], found[-1]._replace(version="99")])
    assert other["serialNumber"] != said["serialNumber"]


def test_a_version_that_is_not_locked_is_refused():
    with pytest.raises(ValueError, match=r"numpy: .* is installed, the lock says 0\.1: run tools/test"):
        components(LOCK | {"numpy": "0.1"})


def test_all_licences_are_known_and_allowed(capsys):
    assert main(["licences"]) == 0
    assert "unknown" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("expression", "fine"),
    [
        ("MIT", True),
        ("EPL-2.0 OR GPL-3.0-only", True),
        ("MIT AND GPL-3.0-only", False),
        ("GPL-2.0-only WITH Classpath-exception-2.0", False),
        ("Apache-2.0 WITH LLVM-exception", True),
        ("(MIT OR GPL-3.0-only) AND AGPL-3.0-only", False),
        ("GPL-3.0-only", False),
        ("", False),
    ],
)
def test_an_expression_is_allowed_where_one_alternative_is(expression, fine):
    assert is_allowed(expression) is fine


def entry(*events, **more):
    return {"ranges": [{"type": "ECOSYSTEM", "events": list(events)}], **more}


@pytest.mark.parametrize(
    ("affected", "version", "hit"),
    [
        (entry({"introduced": "0"}, {"fixed": "1.2"}), "1.1.9", True),
        (entry({"introduced": "0"}, {"fixed": "1.2"}), "1.2", False),
        (entry({"introduced": "0"}, {"fixed": "1.10"}), "1.9", True),  # numbers, not text
        (entry({"introduced": "1.0"}, {"last_affected": "1.5"}), "1.5", True),
        (entry({"introduced": "1.0"}, {"last_affected": "1.5"}), "1.5.1", False),
        (entry({"introduced": "1.0"}, {"fixed": "1.1"}, {"introduced": "2.0"}), "1.5", False),
        (entry({"introduced": "1.0"}, {"fixed": "1.1"}, {"introduced": "2.0"}), "2.1", True),
        (entry({"introduced": "2.0"}, {"introduced": "1.0"}, {"fixed": "1.1"}), "1.0.5", True),  # any order
        (entry({"introduced": "0"}), "99", True),
        (entry({"introduced": "0"}, {"fixed": "not a version"}), "1", True),
        ({"versions": ["1.0", "1.1"]}, "1.1", True),
        ({"versions": ["1.0"]}, "1.1", False),
        ({"ranges": [{"type": "GIT", "events": [{"introduced": "0"}]}]}, "1.1", False),
    ],
)
def test_a_range_is_read_as_osv_defines_it(affected, version, hit):
    assert affects(affected, version) is hit


def record(name, **more):
    affected = {"package": {"ecosystem": "PyPI", "name": name}, **entry({"introduced": "0"}, {"fixed": "2"})}
    return {"id": "T-1", "aliases": ["CVE-2026-1"], "summary": "reads too far", "affected": [affected], **more}


def test_names_are_compared_as_the_index_does_and_withdrawn_ones_are_none():
    have = [Component("some-name", "1.0", "MIT", ()), Component("other", "2.0", "MIT", ())]
    assert [f.package for f in vulnerable(have, [record("Some_Name")])] == ["some-name"]
    assert vulnerable(have, [record("other")]) == []
    assert vulnerable(have, [record("some-name", withdrawn="2026-01-01")]) == []
    foreign = record("some-name")
    foreign["affected"][0]["package"]["ecosystem"] = "npm"
    assert vulnerable(have, [foreign]) == []


@pytest.mark.parametrize("kind", ["zip", "folder"])
def test_the_command_reads_an_export_without_network(tmp_path, capsys, kind):
    numpy = record("numpy")
    numpy["affected"][0]["ranges"][0]["events"][1]["fixed"] = "999"
    files = {"a.json": json.dumps(numpy), "b.json": json.dumps(record("unknown-package"))}
    path = tmp_path / "all.zip"
    if kind == "zip":
        with ZipFile(path, "w") as archive:
            for name, text in files.items():
                archive.writestr(name, text)
    else:
        path = tmp_path
        for name, text in files.items():
            (path / name).write_text(text)
    output = tmp_path / "found.txt"
    assert main(["vulnerabilities", "--osv", str(path), "--json", str(output)]) == 1
    told = capsys.readouterr().out
    assert f"numpy {LOCK['numpy']}: T-1 CVE-2026-1: reads too far, fixed in 999" in told
    assert [f["package"] for f in json.loads(output.read_text())] == ["numpy"]


def test_none_known_is_exit_code_0_and_no_records_at_all_is_an_error(tmp_path):
    (tmp_path / "a.json").write_text(json.dumps(record("unknown-package")))
    assert main(["vulnerabilities", "--osv", str(tmp_path)]) == 0
    (tmp_path / "a.json").unlink()
    with pytest.raises(ValueError, match="holds no OSV record"):
        list(advisories(tmp_path))
