"""The packages that run on a controller: a bill of materials, their licences, their known vulnerabilities.

Versions come from requirements.lock, licences and dependencies from the packages' own metadata. Nothing asks the
network: the vulnerability database is a file, so that a check can be repeated."""

import argparse
import json
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from typing import Any, NamedTuple
from uuid import NAMESPACE_URL, uuid5
from zipfile import ZipFile

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import InvalidVersion, Version

import cylforce

ROOT = Path(__file__).resolve().parents[1]
EXTRAS = ("display", "mqtt", "remote", "report", "tables")  # what may be installed on a controller; not the tests' own
# Licences under which a package may be shipped beside an Apache-2.0 program: permissive, or copyleft that ends at the
# package (LGPL, MPL; a user can replace the package, for it is installed as such)
ALLOWED = {
    *("MIT", "MIT-CMU", "BSD-2-Clause", "BSD-3-Clause", "0BSD", "Apache-2.0", "ISC", "Zlib", "CC0-1.0", "PSF-2.0"),
    *("LGPL-3.0-only", "LGPL-3.0-or-later", "MPL-2.0", "EPL-2.0", "Unlicense", "Python-2.0", "MIT-0", "BSL-1.0"),
}
# Trove classifiers and free words of older metadata -> SPDX
_SPDX = {
    "MIT License": "MIT",
    "BSD License": "BSD-3-Clause",
    "Apache Software License": "Apache-2.0",
    "Python Software Foundation License": "PSF-2.0",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
    "GNU Lesser General Public License v3 (LGPLv3)": "LGPL-3.0-only",
    "GNU Lesser General Public License v3 or later (LGPLv3+)": "LGPL-3.0-or-later",
    "ISC License (ISCL)": "ISC",
    "The Unlicense (Unlicense)": "Unlicense",
}
_OPERATORS = re.compile(r"[()]|\b(?:AND|OR|WITH)\b")


class Component(NamedTuple):
    """A package: normalised name, locked version, SPDX expression (empty: unknown), names of what it needs."""

    name: str
    version: str
    licence: str
    needs: tuple[str, ...]

    @property
    def purl(self) -> str:
        """The package URL."""
        return f"pkg:pypi/{self.name}@{self.version}"


def locked(text: str) -> dict[str, str]:
    """Versions by normalised name from the text of requirements.lock."""
    lines = (line for line in text.splitlines() if line and not line.startswith("#"))
    return {canonicalize_name(name): version for name, _, version in (line.partition("==") for line in lines)}


def needed(found: Distribution, extras: Sequence[str]) -> Iterator[tuple[str, tuple[str, ...]]]:
    """What a distribution requires on this platform: (name, extras)."""
    for text in found.requires or ():
        said = Requirement(text)
        if said.marker is None or any(said.marker.evaluate({"extra": extra}) for extra in ("", *extras)):
            yield canonicalize_name(said.name), tuple(sorted(said.extras))


def components(versions: Mapping[str, str], extras: Sequence[str] = EXTRAS) -> list[Component]:
    """cylforce's dependencies with theirs, by name; the first is cylforce itself. Raises ValueError for one that is not
    installed, or not in the version of the lock."""
    waiting, made = [("cylforce", tuple(extras))], dict[tuple[str, tuple[str, ...]], Component]()
    while waiting:
        name, wanted = waiting.pop()
        if (name, wanted) in made:
            continue
        found = _installed(name, versions)
        needs = sorted(set(needed(found, wanted)))
        waiting += needs
        names = tuple(dict.fromkeys(need for need, _ in needs if need != name))
        made[name, wanted] = Component(name, _version(found, name), licence_of(found), names)
    whole: dict[str, Component] = {}
    for component in made.values():  # the same package with several extras: all that any of them needs
        before = whole.get(component.name, component)
        whole[component.name] = component._replace(needs=tuple(sorted({*before.needs, *component.needs})))
    return [whole.pop("cylforce"), *(whole[name] for name in sorted(whole))]


def _installed(name: str, versions: Mapping[str, str]) -> Distribution:
    try:
        found = distribution(name)
    except PackageNotFoundError as error:
        raise ValueError(f"{name}: is not installed: tools/test makes the environment with all extras") from error
    if name != "cylforce" and versions.get(name) != found.version:
        raise ValueError(f"{name}: {found.version} is installed, the lock says {versions.get(name)}: run tools/test")
    return found


def _version(found: Distribution, name: str) -> str:
    return cylforce.__version__ if name == "cylforce" else found.version


def licence_of(found: Distribution) -> str:
    """A distribution's licence as SPDX; empty where its metadata do not say."""
    meta = found.metadata
    if "License-Expression" in meta:
        return str(meta["License-Expression"])
    classified = [text.rpartition(" :: ")[2] for text in meta.get_all("Classifier") or () if text.startswith("License")]
    said = sorted({_SPDX[text] for text in classified if text in _SPDX})
    word = str(meta["License"] or "") if "License" in meta else ""
    return " OR ".join(said) or (word if word in ALLOWED else "")


def is_allowed(expression: str) -> bool:
    """Whether one of the alternatives of an SPDX expression has only allowed licences; with brackets all of them must
    be allowed. Exceptions (WITH) only add rights."""
    plain = re.sub(r"\bWITH\s+[\w.-]+", "", expression)
    choices = [plain] if "(" in plain else re.split(r"\bOR\b", plain)
    named = [_OPERATORS.sub(" ", choice).split() for choice in choices]
    return any(names and ALLOWED.issuperset(names) for names in named)


def bill(found: Sequence[Component]) -> dict[str, Any]:
    """CycloneDX 1.6. The same packages give the same bytes: no time, and a serial number made of the content."""
    ours, *others = found
    content = "\n".join(f"{c.purl} {c.licence} {' '.join(c.needs)}" for c in found)
    refs = {c.name: c.purl for c in found}
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "serialNumber": f"urn:uuid:{uuid5(NAMESPACE_URL, content)}",
        "version": 1,
        "metadata": {"component": {**_described(ours), "type": "application"}},
        "components": [_described(c) for c in others],
        "dependencies": [{"ref": c.purl, "dependsOn": [refs[need] for need in c.needs]} for c in found],
    }


def _described(c: Component) -> dict[str, Any]:
    licence = {"licenses": [{"expression": c.licence}]} if c.licence else {}
    return {"type": "library", "bom-ref": c.purl, "name": c.name, "version": c.version, "purl": c.purl, **licence}


class Finding(NamedTuple):
    """A known vulnerability of a package as it is locked."""

    package: str
    version: str
    identifier: str
    aliases: tuple[str, ...]
    summary: str
    fixed: tuple[str, ...]


def advisories(path: Path) -> Iterator[dict[str, Any]]:
    """The records of an OSV export: a ZIP, or a folder of JSON files. Raises ValueError where there is none."""
    count = 0
    for text in _texts(path):
        count += 1
        yield json.loads(text)
    if not count:
        raise ValueError(f"{path}: holds no OSV record: name the export for PyPI (a ZIP, or its files in a folder)")


def _texts(path: Path) -> Iterator[bytes]:
    if path.is_dir():
        yield from (file.read_bytes() for file in sorted(path.glob("*.json")))
        return
    with ZipFile(path) as archive:
        yield from (archive.read(name) for name in sorted(archive.namelist()) if name.endswith(".json"))


def vulnerable(found: Sequence[Component], records: Iterable[Mapping[str, Any]]) -> list[Finding]:
    """Which records are about a component in its version; withdrawn ones are left out."""
    versions = {c.name: c.version for c in found}
    return sorted(
        finding for record in records if not record.get("withdrawn") for finding in _findings(record, versions)
    )


def _findings(record: Mapping[str, Any], versions: Mapping[str, str]) -> Iterator[Finding]:
    for affected in record.get("affected", ()):
        package = affected.get("package", {})
        name = canonicalize_name(package.get("name", ""))
        if package.get("ecosystem") == "PyPI" and name in versions and affects(affected, versions[name]):
            events = [event for said in affected.get("ranges", ()) for event in said.get("events", ())]
            fixed = tuple(event["fixed"] for event in events if "fixed" in event)
            aliases, words = tuple(record.get("aliases", ())), str(record.get("summary", "")).strip()
            yield Finding(name, versions[name], str(record["id"]), aliases, words, fixed)


def affects(affected: Mapping[str, Any], version: str) -> bool:
    """Whether an OSV entry affects a version: it is listed, or lies within a range (OSV schema, "evaluation")."""
    if version in affected.get("versions", ()):
        return True
    ranges = (said for said in affected.get("ranges", ()) if said.get("type") == "ECOSYSTEM")
    return any(_within(said.get("events", ()), Version(version)) for said in ranges)


def _within(events: Iterable[Mapping[str, str]], version: Version) -> bool:
    """Events in order of version: introduced begins, fixed and limit end before, last_affected ends after theirs."""
    inside = False
    for kind, at in sorted(_dated(events), key=lambda event: event[1]):
        if kind == "introduced" and version >= at:
            inside = True
        elif (kind in ("fixed", "limit") and version >= at) or (kind == "last_affected" and version > at):
            inside = False
    return inside


def _dated(events: Iterable[Mapping[str, str]]) -> Iterator[tuple[str, Version]]:
    for event in events:
        for kind, text in event.items():
            try:
                yield kind, Version("0.dev0" if text == "0" else text)
            except InvalidVersion:
                continue


def _arguments(words: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="tools/supply", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("sbom").add_argument("-o", "--output", type=Path)
    commands.add_parser("licences")
    known = commands.add_parser("vulnerabilities")
    known.add_argument("--osv", type=Path, required=True)
    known.add_argument("--json", type=Path)
    return parser.parse_args(words)


def main(words: Sequence[str] | None = None) -> int:
    """The command line; the exit code."""
    said = _arguments(words)
    found = components(locked((ROOT / "requirements.lock").read_text()))
    if said.command == "sbom":
        text = json.dumps(bill(found), indent=1) + "\n"
        _ = said.output.write_text(text) if said.output else sys.stdout.write(text)
        return 0
    return _licences(found) if said.command == "licences" else _vulnerabilities(found, said.osv, said.json)


def _licences(found: Sequence[Component]) -> int:
    for c in found:
        mark = "" if is_allowed(c.licence) else "   <-- not on the list of tools/supply.py"
        print(f"{c.name:28} {c.version:14} {c.licence or 'unknown'}{mark}")
    return int(any(not is_allowed(c.licence) for c in found))


def _vulnerabilities(found: Sequence[Component], osv: Path, output: Path | None) -> int:
    known = vulnerable(found, advisories(osv))
    for finding in known:
        fixed = f", fixed in {', '.join(finding.fixed)}" if finding.fixed else ""
        names = " ".join((finding.identifier, *finding.aliases))
        print(f"{finding.package} {finding.version}: {names}: {finding.summary}{fixed}")
    print(f"{len(known)} known vulnerabilities in {len(found) - 1} packages")
    if output is not None:
        output.write_text(json.dumps([finding._asdict() for finding in known], indent=1) + "\n")
    return int(bool(known))


if __name__ == "__main__":
    sys.exit(main())
