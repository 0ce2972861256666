"""Lines on a stream that nobody has to read: they are written by a thread of their own, out of a queue that drops and
counts. A reader that stopped, a full pipe or a full disk never delays a step."""

import atexit
import json
import os
import sys
import threading
import time
from contextlib import suppress
from queue import Full, Queue
from typing import TextIO, cast

import structlog

ROOM = 1000  # lines that wait at most; chosen: ten seconds of a line at every step
LAST_S = 0.5  # for lines that still wait at the end; chosen: shorter than a watchdog's second


class Messages:
    """A text stream of lines. A stream without a file behind it (a test's buffer) is written at once: it cannot block.

    dropped:  number of lines that were dropped so far, because the reader was too slow
    reported: number of them that a message has reported
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream, self._line = stream, ""
        self.dropped = 0
        self.reported = 0
        self._waiting = Queue[str](ROOM)
        self._fd = _descriptor(stream)
        if self._fd is not None:
            with suppress(OSError, ValueError):
                stream.flush()
            threading.Thread(target=self._work, args=(self._fd,), name="messages", daemon=True).start()

    def write(self, text: str) -> None:
        """Take text; every whole line is queued, or dropped if there is no room."""
        *lines, self._line = (self._line + text).split("\n")
        for line in lines:
            self._put(f"{line}\n")

    def flush(self) -> None:
        """Do nothing: lines are written as soon as possible."""

    def close(self) -> None:
        """Wait up to LAST_S until all lines are written."""
        if self._fd is not None:
            done = self._waiting.all_tasks_done
            with done:
                done.wait_for(lambda: not self._waiting.unfinished_tasks, LAST_S)

    def _put(self, line: str) -> None:
        if self._fd is None:
            with suppress(OSError, ValueError):
                self._stream.write(line)
            return
        try:
            if self.dropped > self.reported:
                self._waiting.put_nowait(json.dumps({"event": "messages dropped", "dropped": self.dropped}) + "\n")
                self.reported = self.dropped
            self._waiting.put_nowait(line)
        except Full:
            self.dropped += 1

    def _work(self, fd: int) -> None:
        while True:
            rest = self._waiting.get().encode("utf-8", "replace")
            while rest:
                try:
                    rest = rest[os.write(fd, rest) :]
                except BlockingIOError:
                    time.sleep(0.01)  # whoever gave us the stream does not want to be waited for
                except OSError:
                    break  # closed or full: measuring goes on without these lines
            self._waiting.task_done()


def _descriptor(stream: TextIO) -> int | None:
    """Return a descriptor of our own for the stream's file; None without a file.

    When the stream is closed, its own number may become another file's.
    """
    try:
        return os.dup(stream.fileno())
    except (OSError, ValueError, AttributeError):
        return None


_current: list[Messages] = []


def configure_messages(stream: TextIO | None = None) -> None:
    """Configure logging as JSON lines on standard error or another stream."""
    _current[:] = [Messages(stream or sys.stderr)]
    structlog.configure(
        processors=[
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            structlog.processors.JSONRenderer(default=str),
        ],
        logger_factory=structlog.PrintLoggerFactory(cast(TextIO, _current[0])),
        cache_logger_on_first_use=True,
    )


@atexit.register
def _last_messages() -> None:
    """Write the remaining lines at the end of a program."""
    for messages in _current:
        messages.close()
