"""Effects of the user's own, read from a Python file: `--library FILE.py`."""

import sys
from dataclasses import MISSING, fields, is_dataclass
from hashlib import sha256
from pathlib import Path
from traceback import extract_tb
from types import ModuleType
from typing import Any

from cylforce.effects.fault import Fault
from cylforce.effects.library import LIBRARY, UNKNOWN, Group
from cylforce.effects.own_effects import METHODS, check_groups
from cylforce.files.atomic import LARGEST, is_large, is_stream
from cylforce.mechanics.machine import Machine
from cylforce.settings.error import SettingsError

CURE = "give a Python file with effect classes (see src/cylforce/effects/README.md)"


def load_library(path: Path, machine: Machine | None = None) -> tuple[Group, ...]:
    """Run a Python file and return its effects, to be appended to the library.

    Every class of the file that has an `about` is an effect of its own, with the defaults of its fields. A tuple
    `LIBRARY` of groups in the file is taken instead: for effects with several sizes or several starting values.
    Where the `machine` is known, every effect is tried on a test motion at all its places.

    Raises SettingsError: one sentence with file, class and cure."""
    module = _run(path, _source(path))
    groups = _groups(path, module)
    taken = {group[0].about.name for group in LIBRARY} | {UNKNOWN}
    try:
        check_groups(groups, taken, machine)
    except ValueError as error:
        raise SettingsError(f"{path}: {error}") from error
    return groups


def _source(path: Path) -> str:
    """The text of the file. Raises SettingsError."""
    if is_stream(path) or is_large(path):
        raise SettingsError(f"{path}: is no file, or larger than {LARGEST // 10**6} MB: {CURE}")
    if path.suffix != ".py":
        raise SettingsError(f"{path}: does not end in .py: {CURE}")
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise SettingsError(f"{path}: cannot be read ({error.strerror}): {CURE}") from error
    except UnicodeDecodeError as error:
        raise SettingsError(f"{path}: is no text (byte {error.start}): {CURE}") from error


def _run(path: Path, text: str) -> ModuleType:
    """The module that the file makes. Raises SettingsError with the line where it fails."""
    # a name of its own for every text: dataclasses look their module up by it
    name = f"cylforce_library_{sha256(f'{path.resolve()}{text}'.encode()).hexdigest()[:16]}"
    module = ModuleType(name)
    module.__file__ = str(path)
    sys.modules[name] = module
    try:
        exec(compile(text, str(path), "exec"), module.__dict__)  # noqa: S102 - the user's own file, at his wish
    except SyntaxError as error:
        raise SettingsError(f"{path}:{error.lineno}: is no Python ({error.msg}): correct it") from error
    except (Exception, SystemExit) as error:
        lines = [frame.lineno for frame in extract_tb(error.__traceback__) if frame.filename == str(path)]
        line = f":{lines[-1]}" if lines else ""
        raise SettingsError(f"{path}{line}: fails ({type(error).__name__}: {error}): correct it") from error
    return module


def _groups(path: Path, module: ModuleType) -> tuple[Group, ...]:
    """The groups of effects of a module: its `LIBRARY`, or one for each class. Raises SettingsError."""
    listed = getattr(module, "LIBRARY", LIBRARY)
    if listed is not LIBRARY:  # else the file has only imported ours
        if not isinstance(listed, tuple) or not listed:
            raise SettingsError(f"{path}: LIBRARY is no tuple of groups: write LIBRARY = ((Squeak(),),)")
        return listed
    classes = [c for c in vars(module).values() if isinstance(c, type) and c.__module__ == module.__name__]
    effects = [c for c in classes if any(hasattr(c, name) for name in ("about", *METHODS))]
    if not effects:
        raise SettingsError(f"{path}: holds no effect: {CURE}")
    return tuple((_made(path, c),) for c in effects)


def _made(path: Path, effect: type[Fault]) -> Fault:
    """The effect with the defaults of its fields. Raises SettingsError."""
    given: Any = effect
    for field in fields(given) if is_dataclass(given) else ():
        if field.init and field.default is MISSING and field.default_factory is MISSING:
            raise SettingsError(
                f"{path}: {effect.__name__}: its field {field.name} has no default: give it one, "
                f"as in {field.name}: float = 1.0"
            )
    try:
        return effect()
    except Exception as error:
        raise SettingsError(
            f"{path}: {effect.__name__}: cannot be made without arguments ({type(error).__name__}: {error}): "
            "write it as a frozen dataclass with defaults, or list your groups in LIBRARY"
        ) from error
