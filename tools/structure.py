"""Measure the structure of the source below src/: files in a folder, lines in a file, lines in a function, import
circles between files, class names, tests for single effects outside effects/.

Sizes are reported only: a file or a function is split where the reader's thought ends. Exit code 1 when files import
each other, a class name is defined twice, or a room outside effects/ tests for a single effect."""

import argparse
import ast
import statistics
import sys
from collections import Counter, defaultdict
from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

SOURCE = Path(__file__).resolve().parents[1] / "src"
SHORT_LINES = 20  # of a function's body, whose share is reported
Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True)
class Module:
    """A source file: dotted name, path relative to the source folder, syntax tree, number of lines."""

    name: str
    path: Path
    tree: ast.Module
    lines: int

    @property
    def folder(self) -> str:
        """The folder, relative to the source folder."""
        return self.path.parent.as_posix()

    @property
    def room(self) -> str:
        """The package directly below the top one; empty for files of the top package itself."""
        return self.path.parts[1] if len(self.path.parts) > 2 else ""

    @property
    def is_package(self) -> bool:
        """Whether this is a package's __init__.py."""
        return self.path.name == "__init__.py"


class Folder(NamedTuple):
    """How many files a folder has (without __init__.py), its largest file and that file's lines."""

    files: int
    largest: str
    lines: int


class Sizes(NamedTuple):
    """Of all functions: how many, the median of their lines, the share of short ones, name and lines of the longest."""

    functions: int
    median: float
    short: float
    longest: str
    lines: int


class Structure(NamedTuple):
    """All that is measured: folders by name, sizes of functions, import circles (file names), files by the name of a
    class that is defined more than once, tests for single effects outside effects/ by room."""

    folders: dict[str, Folder]
    functions: Sizes
    circles: list[list[str]]
    duplicates: dict[str, list[str]]
    effect_tests: dict[str, int]


def modules(source: Path = SOURCE) -> list[Module]:
    """All Python files below a source folder, parsed."""
    found = []
    for path in sorted(source.rglob("*.py")):
        text, relative = path.read_text(), path.relative_to(source)
        parts = relative.with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        found.append(Module(name, relative, ast.parse(text), len(text.splitlines())))
    return found


def structure(found: Sequence[Module]) -> Structure:
    """Everything that is measured."""
    return Structure(folders(found), sizes(found), circles(found), duplicates(found), effect_tests(found))


def folders(found: Iterable[Module]) -> dict[str, Folder]:
    """Files of every folder that has any."""
    by_folder = defaultdict(list)
    for module in found:
        by_folder[module.folder].append(module)
    return {name: _folder(files) for name, files in sorted(by_folder.items())}


def _folder(files: Sequence[Module]) -> Folder:
    largest = max(files, key=lambda module: module.lines)
    return Folder(sum(not module.is_package for module in files), largest.path.name, largest.lines)


def functions(found: Iterable[Module]) -> Iterator[tuple[str, Function]]:
    """Every function, method and nested function, with its place."""
    for module in found:
        for node in ast.walk(module.tree):
            if isinstance(node, Function):
                yield f"{module.path.as_posix()}:{node.lineno} {node.name}", node


def body_lines(function: Function) -> int:
    """Lines of the body without the docstring, those of nested functions included."""
    body = function.body[1:] if ast.get_docstring(function) is not None else function.body
    return (body[-1].end_lineno or body[-1].lineno) - body[0].lineno + 1 if body else 0


def sizes(found: Iterable[Module]) -> Sizes:
    """Sizes of all functions."""
    lines = {name: body_lines(node) for name, node in functions(found)} or {"": 0}
    longest = max(lines, key=lambda name: lines[name])
    short = sum(size <= SHORT_LINES for size in lines.values()) / len(lines)
    return Sizes(len(lines), statistics.median(lines.values()), short, longest, lines[longest])


def imported(module: Module, known: Container[str]) -> set[str]:
    """Names of the known modules that a module imports anywhere: also within functions, also for types only."""
    found = set()
    for node in ast.walk(module.tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = _base(module, node)
            full = {alias.name: f"{base}.{alias.name}" for alias in node.names}
            found |= {full[name] if full[name] in known else base for name in full}
    return {name for name in found if name in known}


def _base(module: Module, node: ast.ImportFrom) -> str:
    """The absolute name of the package or module that `from ... import` names."""
    if not node.level:
        return node.module or ""
    parts = module.name.split(".")
    parts = parts[: len(parts) - node.level + module.is_package]
    return ".".join([*parts, *([node.module] if node.module else [])])


def circles(found: Sequence[Module]) -> list[list[str]]:
    """Groups of files that import each other, directly or through others: strong components of the import graph."""
    number = {module.name: k for k, module in enumerate(found)}
    edges = [(k, number[name]) for k, module in enumerate(found) for name in imported(module, number)]
    begins, ends = zip(*edges, strict=True) if edges else ((), ())
    graph = csr_array((np.ones(len(edges)), (begins, ends)), shape=(len(found), len(found)))
    count, group = connected_components(graph, connection="strong")
    groups: list[list[str]] = [[] for _ in range(count)]
    for k, module in zip(group.tolist(), found, strict=True):
        groups[k].append(module.name)
    return [names for names in groups if len(names) > 1]


def classes(module: Module) -> list[str]:
    """Names of the classes that a file defines."""
    return [node.name for node in ast.walk(module.tree) if isinstance(node, ast.ClassDef)]


def duplicates(found: Iterable[Module]) -> dict[str, list[str]]:
    """Files of every class name that is defined more than once."""
    places = defaultdict(list)
    for module in found:
        for name in classes(module):
            places[name].append(module.path.as_posix())
    return {name: paths for name, paths in sorted(places.items()) if len(paths) > 1}


def effect_tests(found: Sequence[Module]) -> dict[str, int]:
    """How often each room but effects asks whether a value is of one single effect's class: isinstance, issubclass or a
    pattern of `match`. Classes of single effects are those defined in the folders below effects/."""
    single = [module for module in found if module.room == "effects" and len(module.path.parts) > 3]
    effects = {name for module in single for name in classes(module)}
    asked: Counter[str] = Counter()
    for module in found:
        if module.room not in ("effects", ""):
            asked[module.room] += sum(bool(_tested(node) & effects) for node in ast.walk(module.tree))
    return dict(sorted(asked.items()))


def _tested(node: ast.AST) -> set[str]:
    """Names of the classes that an expression or a pattern tests for."""
    match node:
        case ast.Call(func=ast.Name(id="isinstance" | "issubclass"), args=[_, kinds]):
            tested: ast.AST = kinds
        case ast.MatchClass(cls=kind):
            tested = kind
        case _:
            return set()
    names = {part.id for part in ast.walk(tested) if isinstance(part, ast.Name)}
    return names | {part.attr for part in ast.walk(tested) if isinstance(part, ast.Attribute)}


def broken(found: Structure) -> Iterator[str]:
    """Yield a sentence for every rule that is broken."""
    for names in found.circles:
        yield f"these files import each other: {', '.join(names)}"
    for name, paths in found.duplicates.items():
        yield f"class {name} is defined {len(paths)} times: {', '.join(paths)}"
    for room, count in found.effect_tests.items():
        if count:
            yield f"{room} tests {count} times for single effects: let the effect say what is asked of it"


def show(found: Structure, console: Console) -> None:
    """The figures."""
    table = Table(title="Folders (files without __init__.py)")
    table.add_column("folder")
    for column in ("files", "largest file", "lines"):
        table.add_column(column, justify="right")
    for name, folder in found.folders.items():
        table.add_row(name, str(folder.files), folder.largest, str(folder.lines))
    console.print(table)
    f = found.functions
    console.print(f"functions: {f.functions}; lines of the body: median {f.median:g},")
    console.print(f"  {f.short:.1%} at most {SHORT_LINES}, longest {f.lines}: {f.longest}")
    console.print(f"import circles between files: {len(found.circles)}")
    console.print(f"class names defined more than once: {len(found.duplicates)}")
    tests = [f"{room} {count}" for room, count in found.effect_tests.items() if count]
    console.print(f"tests for single effects outside effects/: {', '.join([*tests, 'all other rooms 0'])}")


def main() -> int:
    """Measure and print; 1 when a rule is broken."""
    parser = argparse.ArgumentParser(prog="structure", description=__doc__)
    parser.add_argument("source", nargs="?", type=Path, default=SOURCE, metavar="FOLDER", help="default: src/")
    options = parser.parse_args()
    found = structure(modules(options.source))
    show(found, Console(highlight=False, soft_wrap=True))
    for sentence in (sentences := list(broken(found))):
        print(f"structure: {sentence}", file=sys.stderr)
    return 1 if sentences else 0


if __name__ == "__main__":
    sys.exit(main())
