"""One line of candump text, `(seconds.micros) CHANNEL ID#DATA`, from an event and back.

Ticks, and the frames that our node sent, are on channels of their own, by which replay recognises them. A tick is
written as an empty SYNC frame, which protocol analysers accept.
"""

import re
from collections.abc import Iterable, Iterator
from functools import lru_cache
from typing import NamedTuple

from cylforce.signals.events import ERROR, EXTENDED, REMOTE, Event, Frame, Tick

HEAD, TICK, SENT = "cylforce", "tick", "sent"  # pseudo-channels; can-utils accepts no more than 15 characters
_TICK_ID = 0x080  # identifier of SYNC
_ID_BITS = 0x1FFFFFFF  # bits of an identifier without SocketCAN's flags
_SIXTEEN_DIGITS = 10**15  # smallest number of 16 digits
_LINE = re.compile(
    r"\((\d+)\.(\d{1,9})\) +(\S+) +([\dA-Fa-f]{3}|[0-3][\dA-Fa-f]{7})"
    r"#(?:R([0-8]?)|((?:[\dA-Fa-f]{2}){0,8}))(?:_[\dA-Fa-f])?(?: +[RT])?\s*",
    re.ASCII,
)
_OURS = re.compile(  # as `line` writes frames with identifiers of 11 bits
    r"^\((\d{10})\.(\d{6})\) (\S+) ([\dA-F]{3})#((?:[\dA-F]{2}){0,8})\n", re.ASCII | re.MULTILINE
)
_STANDARD = {f"{can_id:03X}": can_id for can_id in range(0x1000)}  # number of each identifier of three digits
_NEWER = re.compile(  # CAN FD; CAN XL
    r"\(\d+\.\d+\) +\S+ +[\dA-Fa-f]{3,8}"
    r"(?:##[\dA-Fa-f]|#[\dA-Fa-f]{2}:[\dA-Fa-f]{2}:[\dA-Fa-f]{8}#)[\dA-Fa-f]*(?: +[RT])?\s*",
    re.ASCII,
)


class Sent(NamedTuple):
    """A frame that our own node sent. It is logged to compare a replay with; it is not an event.

    t_us: time at which it was sent [us]
    can_id: identifier
    data: its data
    """

    t_us: int
    can_id: int
    data: bytes


class Line(NamedTuple):
    """One parsed line.

    channel: name of the bus, or a pseudo-channel
    t_us: time stamp [us]
    can_id: identifier with SocketCAN's flag bits
    data: data of the frame
    """

    channel: str
    t_us: int
    can_id: int
    data: bytes


@lru_cache(maxsize=4096)
def _prefix(channel: str, can_id: int) -> str:
    """Return the text of a line between time and data, which all lines of an identifier have in common.

    channel: name of the bus, or a pseudo-channel
    can_id: identifier with SocketCAN's flag bits
    """
    name = f"{can_id:03X}" if can_id <= 0x7FF else _flagged(can_id)
    return f") {channel} {name}#"


def _flagged(can_id: int) -> str:
    """Return an identifier with a flag bit, or of more than 11 bits, as text.

    Extended identifiers have eight digits; so have error frames, which begin with the digit 2. Remote frames with 11
    bits have three.
    """
    if can_id & ERROR:
        return f"{can_id & (_ID_BITS | ERROR):08X}"
    return f"{can_id & _ID_BITS:08X}" if can_id & EXTENDED else f"{can_id & _ID_BITS:03X}"


def event_line(event: Event | Sent, channel: str) -> str:
    """Return the line of an event or of a frame that our node sent.

    channel: name of the bus
    """
    return event_lines((event,), channel)


def event_lines(events: Iterable[Event | Sent], channel: str) -> str:
    """Return the lines of several events, one after the other.

    Of a remote frame only the length is written: it has no data.

    channel: name of the bus, for received frames; ticks and sent frames get their pseudo-channels
    """
    lines = list[str]()
    for event in events:
        if isinstance(event, Tick):
            can_id, data, prefix = _TICK_ID, b"", _prefix(TICK, _TICK_ID)
        else:
            can_id, data = event.can_id, event.data
            prefix = _prefix(channel if isinstance(event, Frame) else SENT, can_id)
        time = str(event.t_us)  # divided as text: arithmetic with such large numbers takes longer
        time = time if event.t_us >= _SIXTEEN_DIGITS else time.zfill(16)
        text = data.hex().upper() if can_id < REMOTE or not can_id & REMOTE else f"R{len(data) or ''}"
        lines.append(f"({time[:-6]}.{time[-6:]}{prefix}{text}\n")
    return "".join(lines)


Parts = tuple[str, int, int, bytes]  # the fields of a `Line`, as a plain tuple: faster to make, a million a minute


def parsed(text: str) -> Line | None:
    """Parse a line of candump text, ours or another program's; None when it is not such a line."""
    fields = parts(text)
    return None if fields is None else Line(*fields)


def parts(text: str) -> Parts | None:
    """Parse a line as `parsed`, into a plain tuple of a `Line`'s fields, which takes two thirds of the time.

    None when it is not such a line. Fractions of other lengths than six digits are cut or filled to microseconds. The R
    or T that python-can adds is ignored.
    """
    match = _LINE.fullmatch(text)
    if match is None:
        return None
    seconds, fraction, channel, name, remote, data = match.groups()
    can_id = int(name, 16)
    if len(name) == 8 and not can_id & ERROR:
        can_id |= EXTENDED
    t_us = int(seconds + fraction) if len(fraction) == 6 else int(seconds + fraction[:6].ljust(6, "0"))
    if remote is None:
        return channel, t_us, can_id, bytes.fromhex(data)
    return channel, t_us, can_id | REMOTE, bytes(int(remote or 0))


def parts_of(block: str) -> list[Parts] | None:
    """Parse all lines of a block at once, into the fields of a `Line` each, which takes half the time.

    None if a line is not in our own format.
    """
    matches = _OURS.findall(block)
    if len(matches) != block.count("\n") or not block.endswith("\n"):
        return None
    return [
        (channel, int(seconds + micros), _STANDARD[name], bytes.fromhex(data))
        for seconds, micros, channel, name, data in matches
    ]


def is_newer_frame(text: str) -> bool:
    """Return whether a line is a CAN FD or CAN XL frame, which no sensor of ours sends."""
    return _NEWER.fullmatch(text) is not None


def own_events(lines: Iterable[Parts]) -> Iterator[Event | Sent]:
    """Yield the events and sent frames that the lines of our own log represent, without its header."""
    for channel, t_us, can_id, data in lines:
        if channel == TICK:
            yield Tick(t_us)
        elif channel != HEAD:
            yield Sent(t_us, can_id, data) if channel == SENT else Frame(t_us, can_id, data)


def own_event(line: Parts) -> Event | Sent:
    """Return the event, or the sent frame, that one line of our own log, behind its header, represents."""
    channel, t_us, can_id, data = line
    if channel == TICK:
        return Tick(t_us)
    return Sent(t_us, can_id, data) if channel == SENT else Frame(t_us, can_id, data)
