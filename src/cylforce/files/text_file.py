"""Reading a text file that a user names: settings, effects, motions."""

from pathlib import Path

from cylforce.files.atomic import LARGEST, RecordingError, is_large, is_stream


def read_text(path: Path, cure: str, error: type[Exception] = RecordingError) -> str:
    """Return the text of a file in UTF-8, without a byte order mark.

    Raises `error` where it cannot be read or is not UTF-8, and for a pipe, whose reading may never end, or a file
    larger than any settings.

    cure:  what to do, for the error's text
    error: class of the error, whose text names the file and the cure
    """
    if is_stream(path):
        raise error(f"{path}: is no ordinary file but a pipe or a device: {cure}")
    if is_large(path):
        raise error(f"{path}: is larger than {LARGEST // 10**6} MB: {cure}")
    try:
        return path.read_bytes().decode("utf-8-sig")
    except OSError as fault:
        raise error(f"{path}: cannot be read ({fault.strerror}): {cure}") from fault
    except UnicodeDecodeError as fault:
        raise error(f"{path}: is not UTF-8 text at byte {fault.start}: {cure}") from fault
