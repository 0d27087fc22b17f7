"""Exchanges on a Modbus line, read from what was written down of it, by the names of what was asked. Pure."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

OBJECT, READ, READ_COILS, WRITE_COIL, WRITE_COILS = 0x2B, 0x03, 0x01, 0x05, 0x0F
_HEADER = 13
"""Bytes of an FC 43 frame before its data: slave, function code and eleven of the telegram."""
_CRC = 2
CHECK_AT_REST = (0x6041, 0x6061, 0x6064, 0x60FD, 0x60F4, 0x2400, 0x603F, 0x1003)
"""What the daemon's check of a resting drive reads by FC 43, in this order; one that was begun ends beside a job."""
NAMES = {
    0x2400: "marker", 0x603F: "error code", 0x6040: "controlword", 0x6041: "statusword", 0x6060: "mode",
    0x6064: "position", 0x607A: "target", 0x6081: "speed",
}  # fmt: skip


@dataclass(frozen=True)
class ObjectAccess:
    """One object of a drive, read or written by FC 43; `value` is None where the answer does not tell it."""

    index: int
    written: bool
    value: int | None


@dataclass(frozen=True)
class Exchange:
    """One request and what came back."""

    sent_s: float
    done_s: float
    request: bytes
    reply: bytes

    @property
    def slave(self) -> int:
        """Return who was asked."""
        return self.request[0]

    @property
    def size(self) -> int:
        """Return the bytes there and back."""
        return len(self.request) + len(self.reply)

    @property
    def object(self) -> ObjectAccess | None:
        """Return the object that is accessed; None where it is another function code."""
        if self.request[1] != OBJECT:
            return None
        written = bool(self.request[3] & 1)
        data = (self.request if written else self.reply)[_HEADER:-_CRC]
        value = int.from_bytes(data, "little", signed=len(data) == 4) if data else None
        return ObjectAccess(int.from_bytes(self.request[6:8], "big"), written, value)

    @property
    def name(self) -> str:
        """Say what is asked or told."""
        access = self.object
        if access is not None:
            name = NAMES.get(access.index, f"{access.index:04X}h")
            return f"{'write' if access.written else 'read'} {name}"
        names = {READ: "read image", READ_COILS: "read lamps", WRITE_COIL: "switch lamp", WRITE_COILS: "switch lamps"}
        return names.get(self.request[1], f"function {self.request[1]}")


def exchanges(lines: Iterable[str]) -> list[Exchange]:
    """Put what was written down together: all that came between two requests is the reply to the first."""
    found: list[Exchange] = []
    open_: tuple[float, bytes] | None = None
    reply, done_s = b"", 0.0

    def close() -> None:
        if open_ is not None:
            found.append(Exchange(open_[0], done_s or open_[0], open_[1], reply))

    for line in lines:
        when_s, direction, data = json.loads(line)
        if direction == "sent":
            close()
            open_, reply, done_s = (when_s, bytes.fromhex(data)), b"", 0.0
        else:
            reply, done_s = reply + bytes.fromhex(data), when_s
    close()
    return found


def without_check_at_rest(part: Sequence[Exchange]) -> list[Exchange]:
    """Leave out what belongs to checks at rest: no job asked for it."""
    kept: list[Exchange] = []
    place: dict[int, int] = {}
    for exchange in part:
        access = exchange.object
        index = access.index if access is not None and not access.written else None
        begins = index == CHECK_AT_REST[0]
        step = 0 if begins else place.get(exchange.slave, len(CHECK_AT_REST))
        if step < len(CHECK_AT_REST) and index == CHECK_AT_REST[step]:
            place[exchange.slave] = step + 1
        else:
            kept.append(exchange)
    return kept


def by_name(part: Sequence[Exchange]) -> list[tuple[str, int]]:
    """Count what was asked, the most frequent first."""
    return Counter(exchange.name for exchange in part).most_common()


def lit_frames(part: Sequence[Exchange]) -> int:
    """Count the lamps' changes to another lit state: no fewer frames were taken."""
    states: list[bytes] = []
    for exchange in part:
        if exchange.request[1] == WRITE_COILS:
            state = exchange.request[7:-_CRC]
            if not states or states[-1] != state:
                states.append(state)
    return sum(any(state) for state in states)
