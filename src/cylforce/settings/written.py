"""Read TOML files that a command of ours has written."""

import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ValidationError

from cylforce.files.atomic import LARGEST, is_large, is_stream
from cylforce.settings.error import SettingsError

M = TypeVar("M", bound=BaseModel)
Check = Callable[[Path, Mapping[str, object]], None]


def read_written(path: Path, kind: type[M], command: str, check: Check | None = None) -> M:
    """Read a file that a command wrote. Raises SettingsError with path, key and cure.

    kind: model of the file
    command: the command, for the cure
    check: function that checks path and tables first
    """
    if is_stream(path):
        raise SettingsError(f"{path}: is no ordinary file but a pipe or a device; run `{command}` first")
    if is_large(path):
        raise SettingsError(f"{path}: is larger than {LARGEST // 10**6} MB; run `{command}` first")
    try:
        raw = tomllib.loads(path.read_text(encoding="utf-8"))
        if check is not None:
            check(path, raw)
        return kind.model_validate(raw)
    except OSError as error:
        raise SettingsError(f"{path}: cannot be read ({error.strerror}); run `{command}` first") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SettingsError(f"{path}: is not TOML ({error}); run `{command}` again") from error
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise SettingsError(f"{path}: {key}: {first['msg']}; run `{command}` again") from error
