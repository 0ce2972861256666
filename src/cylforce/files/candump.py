r"""One line of candump text, `(seconds.micros) CHANNEL ID#DATA`, from an event and back.

Ticks, and the frames that our node sent, are on channels of their own, by which replay recognises them. A tick is
written as an empty SYNC frame, which protocol analysers accept.
"""

import re
from collections.abc import Iterable, Iterator
from functools import lru_cache
from typing import NamedTuple

from cylforce.signals.events import ERROR, EXTENDED, REMOTE, Event, Frame, Tick
from cylforce.signals.quick import new

HEAD, TICK, SENT = "cylforce", "tick", "sent"  # pseudo-channels; can-utils takes no more than 15 characters
_TICK_ID = 0x080
_ID_BITS = 0x1FFFFFFF
_SIXTEEN_DIGITS = 10**15  # the smallest such number
_LINE = re.compile(
    r"\((\d+)\.(\d{1,9})\) +(\S+) +([\dA-Fa-f]{3}|[0-3][\dA-Fa-f]{7})"
    r"#(?:R([0-8]?)|((?:[\dA-Fa-f]{2}){0,8}))(?:_[\dA-Fa-f])?(?: +[RT])?\s*",
    re.ASCII,
)
_OURS = re.compile(  # as `line` writes frames with identifiers of 11 bits
    r"^\((\d{10})\.(\d{6})\) (\S+) ([\dA-F]{3})#((?:[\dA-F]{2}){0,8})\n", re.ASCII | re.MULTILINE
)
_STANDARD = {f"{can_id:03X}": can_id for can_id in range(0x1000)}
_NEWER = re.compile(  # CAN FD; CAN XL
    r"\(\d+\.\d+\) +\S+ +[\dA-Fa-f]{3,8}"
    r"(?:##[\dA-Fa-f]|#[\dA-Fa-f]{2}:[\dA-Fa-f]{2}:[\dA-Fa-f]{8}#)[\dA-Fa-f]*(?: +[RT])?\s*",
    re.ASCII,
)


class Sent(NamedTuple):
    """A frame that our own node sent. It is kept to compare a replay with; it is not an event."""

    t_us: int
    can_id: int
    data: bytes


class Line(NamedTuple):
    """One line, parsed; `can_id` with SocketCAN's flag bits."""

    channel: str
    t_us: int
    can_id: int
    data: bytes


@lru_cache(maxsize=4096)
def _named(channel: str, can_id: int) -> str:
    """Of all lines of an identifier."""
    name = f"{can_id:03X}" if can_id <= 0x7FF else _flagged(can_id)
    return f") {channel} {name}#"


def _flagged(can_id: int) -> str:
    """Extended identifiers have eight digits; so have error frames, which begin with the digit 2."""
    if can_id & ERROR:
        return f"{can_id & (_ID_BITS | ERROR):08X}"
    return f"{can_id & _ID_BITS:08X}" if can_id & EXTENDED else f"{can_id & _ID_BITS:03X}"


def event_line(event: Event | Sent, channel: str) -> str:
    """The line of an event or of a frame that we sent; `channel` is the bus."""
    return event_lines((event,), channel)


def event_lines(events: Iterable[Event | Sent], channel: str) -> str:
    """The lines of several, one after the other. Of a remote frame only the length is written: it has no data."""
    lines = list[str]()
    for event in events:
        if isinstance(event, Frame):
            t_us, can_id, data = event
            name = _named(channel, can_id)
        elif isinstance(event, Tick):
            t_us, can_id, data, name = event.t_us, _TICK_ID, b"", _named(TICK, _TICK_ID)
        else:
            t_us, can_id, data = event
            name = _named(SENT, can_id)
        time = str(t_us)  # divided as text: arithmetic with so large numbers takes longer
        time = time if t_us >= _SIXTEEN_DIGITS else time.zfill(16)
        text = data.hex().upper() if can_id < REMOTE or not can_id & REMOTE else f"R{len(data) or ''}"
        lines.append(f"({time[:-6]}.{time[-6:]}{name}{text}\n")
    return "".join(lines)


Parts = tuple[str, int, int, bytes]  # of a `Line`


def parsed(text: str) -> Line | None:
    """A line of candump text, ours or another program's, parsed; None when it is not such a line."""
    found = parts(text)
    return None if found is None else Line(*found)


def parts(text: str) -> Parts | None:
    """The same as a plain tuple, in two thirds of the time.

    Fractions of other lengths than six digits are cut or filled to microseconds; python-can's trailing R or T
    is ignored."""
    found = _LINE.fullmatch(text)
    if found is None:
        return None
    seconds, fraction, channel, name, remote, data = found.groups()
    can_id = int(name, 16)
    if len(name) == 8 and not can_id & ERROR:
        can_id |= EXTENDED
    t_us = int(seconds + fraction) if len(fraction) == 6 else int(seconds + fraction[:6].ljust(6, "0"))
    if remote is None:
        return channel, t_us, can_id, bytes.fromhex(data)
    return channel, t_us, can_id | REMOTE, bytes(int(remote or 0))


def parts_of(block: str) -> list[Parts] | None:
    """The parts of all lines of a block at once, in half the time; None if a line is not as ours are."""
    found = _OURS.findall(block)
    if len(found) != block.count("\n") or not block.endswith("\n"):
        return None
    return [
        (channel, int(s + micros), _STANDARD[name], bytes.fromhex(data)) for s, micros, channel, name, data in found
    ]


def is_newer_frame(text: str) -> bool:
    """Whether a line is a CAN FD or CAN XL frame, which no sensor of ours sends."""
    return _NEWER.fullmatch(text) is not None


def own_events(lines: Iterable[Parts]) -> Iterator[Event | Sent]:
    """What the lines of our own log stand for, without its head."""
    for said in lines:
        channel = said[0]
        if channel == TICK:
            yield new(Tick, said[1:2])
        elif channel != HEAD:
            yield new(Sent, said[1:]) if channel == SENT else new(Frame, said[1:])


def own_event(said: Parts) -> Event | Sent:
    """The event, or the frame sent, that a line of our own log stands for."""
    channel, t_us, can_id, data = said
    if channel == TICK:
        return Tick(t_us)
    return Sent(t_us, can_id, data) if channel == SENT else Frame(t_us, can_id, data)
