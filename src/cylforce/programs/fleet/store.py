"""Store of a fleet's recordings: a folder, or any store that fsspec supports. Files are read in place."""

import re
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from importlib.util import find_spec
from pathlib import Path, PurePosixPath
from threading import Thread
from types import SimpleNamespace
from typing import IO, Any, NamedTuple, TypeVar, cast

from cylforce.files import logreader, tables
from cylforce.files.atomic import RecordingError

T = TypeVar("T")

ANSWER_S = 30.0  # in which a store must answer a question
SUFFIXES = (*logreader.SUFFIXES, *tables.SUFFIXES)
MACHINE_FILE = "machine.toml"
NEEDED = ("fsspec", "pyarrow", "distributed")
# Time limits of a store that is asked by its S3 interface: a refused connection is told within ANSWER_S.
OPTIONS: dict[str, dict[str, Any]] = {
    "s3": {"config_kwargs": {"connect_timeout": 5, "read_timeout": 20, "retries": {"max_attempts": 2}}}
}
_DATE = re.compile(r"(\d{4})-?(\d{2})-?(\d{2})(?:[T_ -]?(\d{2})[-:.h]?(\d{2})(?:[-:.m]?(\d{2}))?)?")


class Stored(NamedTuple):
    """Recording in a store.

    machine:      name of the machine
    name:         name of the recording
    address:      its address
    machine_file: address of the machine file
    made:         time in its name (ISO); "" without one
    stamp:        mark of the store that changes with the content
    doubt:        why it is not read; "" if it is
    """

    machine: str
    name: str
    address: str
    machine_file: str
    made: str
    stamp: str
    doubt: str = ""


class StoredFile:
    """A file of a store with those methods of a path that readers of recordings use."""

    def __init__(self, address: str) -> None:
        """Open a file of a store.

        address: in the syntax of fsspec, for example s3://bucket/EX-001/2026-03-14.parquet
        """
        self._store, self._inside = opened(address)
        self._address = address
        self.name = PurePosixPath(self._inside).name
        self.suffix = PurePosixPath(self._inside).suffix

    def __str__(self) -> str:
        return self._address

    def open(self, mode: str = "r", **how: Any) -> IO[Any]:  # noqa: ANN401 - as pathlib's
        """Open the file like `Path.open`."""
        found: IO[Any] = self._store.open(self._inside, mode, **how)
        return found

    def exists(self) -> bool:
        """Return whether the file exists."""
        return bool(self._store.exists(self._inside))

    def is_file(self) -> bool:
        """Return whether it is a file."""
        return bool(self._store.isfile(self._inside))

    def is_dir(self) -> bool:
        """Return whether it is a folder."""
        return bool(self._store.isdir(self._inside))

    def stat(self) -> SimpleNamespace:
        """Return the status of the file, which has only its size."""
        return SimpleNamespace(st_size=self._store.size(self._inside))


def check_fleet_extra() -> None:
    """Raise RecordingError if a package that a fleet needs is not installed."""
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        raise RecordingError(f"a fleet needs {' and '.join(missing)}: pip install 'cylforce[fleet]'")


def opened(address: str) -> tuple[Any, str]:
    """Return the store of an address and the path inside it."""
    import fsspec

    protocol = address.partition("://")[0] if "://" in address else "file"
    store, inside = fsspec.core.url_to_fs(address, **OPTIONS.get(protocol, {}))
    return store, str(inside)


def stored_path(address: str) -> Path:
    """Return an address as a path for the readers of recordings."""
    return Path(address) if "://" not in address else cast("Path", StoredFile(address))


def stamp_of(address: str) -> str:
    """Return a mark of a file that changes with its content: size and time, or the store's own mark."""
    store, inside = opened(address)
    return _stamp(store.info(inside))


def _stamp(info: Mapping[str, Any]) -> str:
    marks = [info.get(key) for key in ("size", "ETag", "etag", "mtime", "LastModified", "last_modified")]
    return " ".join(str(mark) for mark in marks if mark is not None)


def within(seconds: float, what: Callable[[], T], sentence: str) -> T:
    """Return the result of a function.

    Raises RecordingError with `sentence` when it fails, or does not return within `seconds`.
    """
    answer: list[T] = []
    failed: list[BaseException] = []

    def ask() -> None:
        try:
            answer.append(what())
        except BaseException as error:  # noqa: BLE001 - stores have errors of any kind; it is told below
            failed.append(error)

    asking = Thread(target=ask, daemon=True)
    asking.start()
    asking.join(seconds)
    if answer:
        return answer[0]
    why = _short(failed[0]) if failed else f"no answer within {seconds:g} s"
    raise RecordingError(f"{sentence}: {why}")


def _short(error: BaseException) -> str:
    if isinstance(error, FileNotFoundError):
        return "does not exist"
    return (str(error).splitlines() or [""])[0][:200] or type(error).__name__


def found_in(addresses: Sequence[str]) -> list[Stored]:
    """Return all recordings below some addresses, in order of machine and time.

    Raises RecordingError when a store cannot be reached or holds none.
    """
    found, files = dict[str, str](), set[str]()
    for address in addresses:
        cure = f"{address}: this place cannot be read (check address, network and access)"
        for path, stamp in within(ANSWER_S, lambda a=address: _listed(a), cure).items():  # type: ignore[misc]
            if PurePosixPath(path).name == MACHINE_FILE:
                files.add(path)
            elif PurePosixPath(path).suffix.lower() in SUFFIXES:
                found[path] = stamp
    if not found:
        raise RecordingError(f"{', '.join(addresses)}: holds no recording ({', '.join(SUFFIXES)})")
    return sorted(_doubted([_stored(path, stamp, files) for path, stamp in found.items()]))


def _listed(address: str) -> dict[str, str]:
    """Return the stamps of all files below an address, by their addresses."""
    store, inside = opened(address)
    whole = store.find(inside, detail=True) or {inside: store.info(inside)}
    local = "://" not in address
    return {path if local else str(store.unstrip_protocol(path)): _stamp(info) for path, info in whole.items()}


def _stored(path: str, stamp: str, files: set[str]) -> Stored:
    folder = path.rpartition("/")[0]
    name = path.rpartition("/")[2]
    own = folder
    while own and f"{own}/{MACHINE_FILE}" not in files and "/" in own:
        own = own.rpartition("/")[0]
    machine_file = f"{own}/{MACHINE_FILE}" if f"{own}/{MACHINE_FILE}" in files else ""
    doubt = "" if machine_file else f"no {MACHINE_FILE} in its folder or above: put the machine file of its type there"
    return Stored(folder.rpartition("/")[2], name, path, machine_file, made(name), stamp, doubt)


def made(name: str) -> str:
    """Return the time in a recording's name, as ISO text; "" without one."""
    match = _DATE.search(name)
    if match is None:
        return ""
    try:
        return datetime(*(int(part or 0) for part in match.groups())).isoformat()  # type: ignore[arg-type]  # noqa: DTZ001
    except ValueError:
        return ""


def _doubted(found: Sequence[Stored]) -> list[Stored]:
    """Return the recordings with distinct machine names and with duplicates marked.

    Machines of one name are named by their folders. A recording that exists in two formats gets a `doubt`.
    """
    folders = dict[str, set[str]]()
    for each in found:
        folders.setdefault(each.machine, set()).add(each.address.rpartition("/")[0])
    kept, seen = list[Stored](), dict[tuple[str, str], str]()
    for each in sorted(found):
        same = folders[each.machine]
        if len(same) > 1:
            folder = each.address.rpartition("/")[0]
            each = each._replace(machine="/".join(folder.split("/")[-2:]))  # noqa: PLW2901 - the same, renamed
        key = each.address.rpartition("/")[0], PurePosixPath(each.name).stem
        if key in seen and not each.doubt:
            each = each._replace(doubt=f"is there twice, as {seen[key]}, too: remove one of both")  # noqa: PLW2901
        seen.setdefault(key, each.name)
        kept.append(each)
    return kept


def namesakes(found: Sequence[Stored]) -> list[str]:
    """Return sentences about machines of one name in several folders."""
    folders = dict[str, set[str]]()
    for each in found:
        folder = each.address.rpartition("/")[0]
        folders.setdefault(folder.rpartition("/")[2], set()).add(folder)
    return [
        f"{name}: is the name of {len(places)} machines ({', '.join(sorted(places))}): they are kept apart by their "
        "folders; rename one, so that each has a name of its own"
        for name, places in sorted(folders.items())
        if len(places) > 1
    ]
