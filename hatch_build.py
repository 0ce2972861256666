"""Compiles the kernel of a step when a wheel is built, or installed for work on it. Without Cython or a C compiler the
wheel holds the interpreted kernel only.

The files of `src/cylforce/estimation/kernel` are put one after the other and the words of `restricted.py` become those
of Cython. No contraction of products and sums, no library but C's own: the same bits as interpreted.

    python hatch_build.py     # compiles it into the source

With `CYLFORCE_TARGET=TRIPLE:FOLDER` in the environment it is compiled for another processor by TRIPLE-gcc, with the
headers of that processor's Python below FOLDER (`tools/cross`)."""

import ast
import os
import re
import subprocess
import sys
import sysconfig
import zlib
from pathlib import Path
from shutil import copy
from tempfile import TemporaryDirectory, mkdtemp
from typing import Any, NamedTuple

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

KERNEL = Path("src/cylforce/estimation/kernel")
HEAD = """# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
# cython: infer_types=True
cimport cython
from cpython.buffer cimport PyBUF_FORMAT, PyBuffer_Release, PyObject_GetBuffer

cdef void* place(object of, char kind, char same) except NULL:
    cdef Py_buffer view
    PyObject_GetBuffer(of, &view, PyBUF_FORMAT)
    found = view.buf if view.itemsize == 8 and (view.format[0] == kind or view.format[0] == same) else NULL
    PyBuffer_Release(&view)
    if found == NULL:
        raise TypeError("the kernel takes arrays of 64-bit numbers, or of 64-bit integers")
    return found

cdef inline long long whole(double number) noexcept:
    return <long long>number

cdef inline double* as_numbers(object of) except NULL:
    return <double*>place(of, c"d", c"d")

cdef inline long long* as_counts(object of) except NULL:
    return <long long*>place(of, c"q", c"l")
"""
WORDS = {
    r"^from math import (.*)$": r"from libc.math cimport \1",
    r"^from (?:cylforce|typing)[\w.]* import (?:\([^)]*\)|.*)$": "",
    r"^(\w+): Count = ": r"cdef Py_ssize_t \1 = ",
    r"^(\w+): Number = ": r"cdef double \1 = ",
    r": Sequence\[\w+\]": ": object",
    r"^@record$": "@cython.cclass",
    r"^def (\w+)(\([^()]*\)) -> ": r"@inner\ndef in_c_\1\2 -> ",
    r"^@inner\n@inner\ndef in_c_": r"@inner\ndef ",
    r"^@inner\ndef (\w+\([^()]*\)) -> None:": r"@inner\ndef \1 -> cython.void:",
    r"^@inner$": "@cython.cfunc\n@cython.exceptval(check=False)",
    r"\bNumbers\b(?!`)": "cython.p_double",
    r"\bCounts\b(?!`)": "cython.p_longlong",
    r"\bNumber\b(?!`)": "cython.double",
    r"\bCount\b(?!`)": "cython.Py_ssize_t",
}


def gates(text: str) -> str:
    """Of each function that the service calls the form that Python calls, which gives that of C the places of the
    arrays' numbers: a view of each array would take longer than the arithmetic."""
    found = []
    for line in ast.parse(text).body:
        if isinstance(line, ast.FunctionDef) and not line.decorator_list:
            given = [(each.arg, ast.unparse(each.annotation or ast.Constant(None))) for each in line.args.args]
            head = ", ".join(f"{kind} {name}" if kind.startswith("Kernel") else name for name, kind in given)
            call = ", ".join(PASSED.get(kind, "{}").format(name) for name, kind in given)
            result = "" if ast.unparse(line.returns or ast.Constant(None)) == "None" else "return "
            found.append(f"def {line.name}({head}):\n    {result}in_c_{line.name}({call})\n")
    return "\n\n".join(found)


PASSED = {"Numbers": "as_numbers({})", "Counts": "as_counts({})"}


def parts(folder: Path) -> list[str]:
    """The kernel's files in their order, as `choice.py` lists them: it cannot be imported before it is installed."""
    for line in ast.parse((folder / "choice.py").read_text(encoding="utf-8")).body:
        if isinstance(line, ast.Assign) and ast.unparse(line.targets[0]) == "PARTS":
            return list(ast.literal_eval(line.value))
    raise OSError(f"{folder / 'choice.py'}: lists no PARTS")


def source(folder: Path) -> str:
    """The kernel as Cython reads it."""
    names = parts(folder)
    text = "\n\n".join((folder / name).read_text(encoding="utf-8") for name in names)
    python = gates(text)
    for word, meaning in WORDS.items():
        text = re.sub(word, meaning, text, flags=re.MULTILINE)
    for name in re.findall(r"^def (\w+)", python, flags=re.MULTILINE):  # one that calls another takes C's form of it
        text = re.sub(rf"\b{name}\(", f"in_c_{name}(", text)
    checksum = zlib.crc32(b"".join((folder / name).read_bytes() for name in names))
    return f"{HEAD}\nTEXT = {checksum}\n{text}\n\n{python}"


class Target(NamedTuple):
    """What the kernel is compiled for: the compiler, folders of headers, the end of an extension's name, the wheel's
    tag (empty: that of this computer)."""

    compiler: list[str]
    include: list[str]
    suffix: str
    tag: str = ""


def target() -> Target:
    """The Python that runs, or that which `CYLFORCE_TARGET` names."""
    triple, _, folder = os.environ.get("CYLFORCE_TARGET", "").partition(":")
    if not triple:
        compiler = str(sysconfig.get_config_var("CC") or "cc").split()
        return Target(compiler, [sysconfig.get_path("include")], str(sysconfig.get_config_var("EXT_SUFFIX")))
    python, version = (
        f"python{sys.version_info[0]}.{sys.version_info[1]}",
        f"{sys.version_info[0]}{sys.version_info[1]}",
    )
    include = [f"{folder}/usr/include/{python}", f"{folder}/usr/include"]
    tag = f"cp{version}-cp{version}-linux_{triple.partition('-')[0]}"
    return Target([f"{triple}-gcc"], include, f".cpython-{version}-{triple}.so", tag)


def compile_kernel(root: Path, into: Path) -> Path:
    """Compile the kernel into a folder. Raises OSError or CalledProcessError where it cannot be compiled."""
    compiler, include, suffix, _ = target()
    with TemporaryDirectory() as name:
        (Path(name) / "compiled.pyx").write_text(source(root / KERNEL), encoding="utf-8")
        built = f"compiled{suffix}"
        cython = [sys.executable, "-m", "cython", "--module-name", "cylforce.estimation.kernel.compiled"]
        options = ["-O3", "-fPIC", "-shared", "-ffp-contract=off", *(f"-I{folder}" for folder in include)]
        # names without folders: they stand in the result, which is to be the same wherever it is built
        for command in ([*cython, "compiled.pyx"], [*compiler, *options, "compiled.c", "-lm", "-o", built]):
            subprocess.run(command, check=True, cwd=name)
        new = into / f"{built}.{os.getpid()}"  # another one may compile at the same time
        copy(Path(name) / built, new)
    return new.replace(into / built)


def compiled_since(root: Path) -> bool:
    """Whether the source holds a kernel for this computer that is younger than all it was compiled from."""
    built = root / KERNEL / f"compiled{target().suffix}"
    of = [root / "hatch_build.py", *(root / KERNEL).glob("*.py")]
    return built.exists() and all(path.stat().st_mtime <= built.stat().st_mtime for path in of)


class KernelHook(BuildHookInterface):
    """Hatchling's hook for wheels."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and make the wheel one for this processor; where that fails, say so and go on. An installation for
        work on the source has the kernel there."""
        root = Path(self.root)
        into = root / KERNEL if version == "editable" else Path(mkdtemp())
        try:
            there = version == "editable" and compiled_since(root)
            built = into if there else compile_kernel(root, into)
        except (OSError, subprocess.CalledProcessError) as error:
            self.app.display_warning(f"the kernel is not compiled, the interpreted one will run: {error}")
            return
        build_data["pure_python"], build_data["infer_tag"] = False, not target().tag
        if target().tag:
            build_data["tag"] = target().tag
        if version != "editable":
            build_data["force_include"][str(built)] = f"cylforce/estimation/kernel/{built.name}"


if __name__ == "__main__":
    compile_kernel(Path(__file__).parent, Path(__file__).parent / KERNEL)
