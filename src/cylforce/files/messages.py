"""Read the frames of .blf and .asc recordings with python-can's readers."""

import struct
import zlib
from collections.abc import Iterator
from io import TextIOWrapper
from pathlib import Path
from typing import BinaryIO

from can import Message
from can.io.asc import ASCReader
from can.io.blf import OBJ_HEADER_BASE_STRUCT, BLFParseError, BLFReader

from cylforce.files.atomic import RecordingError, Report
from cylforce.files.candump import Line
from cylforce.signals.events import ERROR, EXTENDED, REMOTE

_BROKEN = (BLFParseError, struct.error, zlib.error, ValueError, LookupError, EOFError)


class _CountedLines(TextIOWrapper):
    """A text file that counts the lines read: python-can's errors do not name the line.

    number: lines read so far
    """

    number = 0

    def __next__(self) -> str:  # type: ignore[override]  # typeshed's base class reads bytes
        """Return the next line and count it."""
        text = super().__next__()
        self.number += 1
        return text


class _CountedObjects(BLFReader):
    """A BLF file that counts its objects of all kinds, as its header counts them.

    python-can silently omits unsupported objects, and those missing between two containers.

    number: objects read so far
    """

    number = 0

    def _parse_data(self, data: bytes) -> Iterator[Message]:
        """Yield the messages of a container, and count its objects."""
        try:
            yield from super()._parse_data(data)
        finally:  # python-can ends it by an error where an object goes on in the next container
            self.number += _whole_objects(data[: self._pos])


def _whole_objects(data: bytes) -> int:
    """Return the number of objects in data that ends between two objects; up to 7 bytes of padding stand between
    them.
    """
    number, begin = 0, data.find(b"LOBJ")
    while begin >= 0:
        number += 1
        *_, size, _ = OBJ_HEADER_BASE_STRUCT.unpack_from(data, begin)
        begin = data.find(b"LOBJ", begin + max(size, OBJ_HEADER_BASE_STRUCT.size))
    return number


def messages(path: Path, report: Report) -> Iterator[Line]:
    """Yield the classic frames of a recording.

    A path that does not end in .asc is read as .blf. Channels are numbers from 0, times of .asc files begin near 0.
    Raises RecordingError when the file cannot be read. An unfinished end of a file, after a program was killed, is
    omitted with a warning instead.

    report: called with a sentence about omitted frames
    """
    skipped = 0
    try:
        with path.open("rb") as file:
            for message in _asc(path, file) if path.suffix.lower() == ".asc" else _blf(path, file, report):
                skipped += message.is_fd
                if not message.is_fd:
                    yield _line(message)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from error
    if skipped:
        report(f"{path}: {skipped} CAN FD frames were skipped")


def _line(message: Message) -> Line:
    """Return python-can's message as a line. A remote frame gets as many zero bytes as its length."""
    flags = (EXTENDED if message.is_extended_id else 0) | (REMOTE if message.is_remote_frame else 0)
    can_id = message.arbitration_id | (ERROR if message.is_error_frame else flags)
    data = bytes(message.dlc) if message.is_remote_frame else bytes(message.data)
    return Line(str(message.channel), round(message.timestamp * 1e6), can_id, data)


def _blf(path: Path, file: BinaryIO, report: Report) -> Iterator[Message]:
    """Yield the messages of a .blf file; report that frames are missing at its end, or by the count in its header.

    Raises RecordingError where it is broken before its end, or has no frame that can be read.
    """
    number = objects = expected = 0
    try:
        reader = _CountedObjects(file)
        whole = reader.file_size == path.stat().st_size
        for message in reader:
            number += 1
            yield message
        objects, expected = reader.number, reader.object_count
    except _BROKEN as error:
        if number == 0 or file.read(1):
            raise RecordingError(f"{path}: is broken after frame {number}: {_text(error)}") from error
        whole = False
    if not whole:
        report(
            f"{path}: was not closed by its writer, or not copied whole; frames after number {number} may be missing"
        )
    elif objects < expected:
        report(
            f"{path}: holds {objects} objects, its header says {expected}: frames are missing; copy or export it again"
        )


def _asc(path: Path, file: BinaryIO) -> Iterator[Message]:
    """Yield the messages of an .asc file. Raises RecordingError for relative times, or a line that is no frame."""
    text = _CountedLines(file, encoding="latin-1")
    try:
        reader = ASCReader(text)
        for message in reader:
            if reader.timestamps_format == "relative":
                raise RecordingError(f"{path}: its times are relative; save it with absolute times")
            yield message
    except _BROKEN as error:
        raise RecordingError(f"{path}, line {text.number}: is no frame: {_text(error)}") from error


def _text(error: Exception) -> str:
    """Return the text of an error, its class where it has none."""
    return str(error) or type(error).__name__
