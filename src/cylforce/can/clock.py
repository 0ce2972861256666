"""The only clock: microseconds that never jump, and ticks at absolute deadlines.

`asyncio.sleep` wakes up 0.6 to 2 ms late and drifts; a timerfd on CLOCK_MONOTONIC is 0.1 ms late and does not. Python
has `os.timerfd_create` only since 3.13, so it is called through ctypes.
"""

import ctypes
import os
import time

_START_NS = time.time_ns() - time.monotonic_ns()  # wall clock at monotonic time 0, as it was set at the start
_LIBC = ctypes.CDLL(None, use_errno=True)
_ABSOLUTE = 1  # TFD_TIMER_ABSTIME


class _Interval(ctypes.Structure):
    """struct itimerspec: period and first expiry, each in seconds and nanoseconds."""

    _fields_ = [(name, ctypes.c_long) for name in ("period_s", "period_ns", "first_s", "first_ns")]


def now_us() -> int:
    """Return integer microseconds since the epoch.

    It is the wall clock at the start plus the monotonic time elapsed since, so that setting the wall clock changes
    nothing.
    """
    return (_START_NS + time.monotonic_ns()) // 1000


class Timer:
    """Expires at `first + k * period_s`, however late its reader is; `fileno()` is then readable (`loop.add_reader`).

    The first expiry is one period after construction. Raises ValueError if the period is not positive, OSError if the
    kernel provides no timer.

    period_s: period [s]
    """

    def __init__(self, period_s: float) -> None:
        if not 0.0 < period_s < float("inf"):
            raise ValueError(f"a timer's period must be positive, got {period_s} s")
        self._period_ns = round(period_s * 1e9)
        self._first_ns = time.monotonic_ns() + self._period_ns
        self._count = 0
        self._fd = _checked(_LIBC.timerfd_create(time.CLOCK_MONOTONIC, os.O_NONBLOCK | os.O_CLOEXEC))
        interval = _Interval(*divmod(self._period_ns, 10**9), *divmod(self._first_ns, 10**9))
        _checked(_LIBC.timerfd_settime(self._fd, _ABSOLUTE, ctypes.byref(interval), None))

    def fileno(self) -> int:
        """Return the file descriptor, which is non-blocking."""
        return self._fd

    def read(self) -> int:
        """Return the number of expirations since the last call; more than 1: the reader was late; 0: it was early."""
        try:
            expirations = int.from_bytes(os.read(self._fd, 8), "little")
        except BlockingIOError:
            return 0
        self._count += expirations
        return expirations

    @property
    def deadline_us(self) -> int:
        """Time at which the latest expiry that `read` has counted was due, on the scale of `now_us()` [us].

        Before the first one it is the time of construction.
        """
        return (_START_NS + self._first_ns + (self._count - 1) * self._period_ns) // 1000

    def close(self) -> None:
        """Close the timer; a second call has no effect."""
        if self._fd >= 0:
            os.close(self._fd)
        self._fd = -1


def _checked(result: int) -> int:
    """Return the result of a system call; raise OSError, with the text of errno, where it is negative."""
    if result < 0:
        number = ctypes.get_errno()
        raise OSError(number, f"no timer: {os.strerror(number)}")
    return result
