"""One Modbus line: one request at a time, each finished before the next, whatever the callers do."""

import asyncio
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Self, TypeVar

import structlog
from pymodbus.pdu import ModbusPDU
from pymodbus.pdu.bit_message import ReadCoilsRequest, WriteMultipleCoilsRequest
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadWriteMultipleRegistersRequest,
    WriteMultipleRegistersRequest,
)

from drivers.bus import checks, od
from drivers.bus.contract import BusTiming, Line
from drivers.bus.link import ByteTap, Link
from drivers.bus.pdus import OdPdu
from drivers.deadline import Deadline
from drivers.errors import DeadlinePassed, DeviceRefused, LinkError, LinkTimeout, ReplyError

T = TypeVar("T")


@dataclass(slots=True)
class BusStatistics:
    """What happened on the line since it was opened."""

    requests: int = 0
    timeouts: int = 0
    garbled: int = 0
    refused: int = 0
    retries: int = 0


class ModbusBus:
    """A line shared by several slaves.

    Every call takes a deadline and raises LinkTimeout when it passes. A request that is already on the wire is
    finished in the background even then, or when the caller is cancelled, and the line is quiet before the next
    request goes out: a late reply is never taken for the answer to something else. Reads and idempotent writes
    are tried several times; a line that was lost is opened again by a later call, with a bounded back-off.
    """

    def __init__(self, link: Link, timing: BusTiming) -> None:
        self.statistics = BusStatistics()
        self._link = link
        self._timing = timing
        self._lock = asyncio.Lock()
        self._free_at_s = 0.0
        self._open_requests: set[asyncio.Task[ModbusPDU]] = set()
        self._closed = False
        self._labels: dict[int, str] = {}
        self._log = structlog.get_logger().bind(device=str(link.line))

    @classmethod
    async def open(
        cls,
        line: Line,
        *,
        gap_s: float = 0.003,
        timeout_s: float = 0.2,
        late_reply_s: float | None = None,
        attempts: int = 3,
        reconnect_max_s: float = 2.0,
        tap: ByteTap | None = None,
    ) -> Self:
        """Open the line; raise LinkError with the cause when the port is missing, taken or unable.

        `tap(direction, bytes)` sees every byte that passes; it must not block.
        """
        late_s = 2 * timeout_s if late_reply_s is None else late_reply_s
        timing = BusTiming(gap_s, timeout_s, late_s, attempts, reconnect_max_s=reconnect_max_s)
        link = Link(line, timing, tap)
        await link.connect()
        return cls(link, timing)

    async def close(self) -> None:
        """Let the request on the wire finish, then close the port."""
        self._closed = True
        if self._open_requests:
            await asyncio.wait(set(self._open_requests))
        self._link.close()

    def label(self, device_id: int, name: str) -> None:
        """Give a slave the name by which errors speak of it."""
        self._labels[device_id] = name

    def _device(self, device_id: int) -> str:
        name = self._labels.get(device_id)
        where = f"slave {device_id} on {self._link.line}"
        return f"{name} ({where})" if name else where

    @property
    def connected(self) -> bool:
        """Tell whether the port is open as far as the system knows."""
        return self._link.connected

    @property
    def reconnects(self) -> int:
        """Count how often the lost port was opened again."""
        return self._link.reconnects

    # ------------------------------------------------------------------ registers and coils
    async def read_registers(self, device_id: int, address: int, count: int, deadline: Deadline) -> tuple[int, ...]:
        """Read `count` holding registers (FC 3)."""
        request = ReadHoldingRegistersRequest(dev_id=_slave(device_id), address=address, count=count)
        return await self._ask(request, deadline, lambda r, d: checks.registers(r, count, d))

    async def write_registers(
        self,
        device_id: int,
        address: int,
        values: Sequence[int],
        deadline: Deadline,
        *,
        idempotent: bool = True,
    ) -> None:
        """Write registers (FC 16); with `idempotent=False` the request goes out once only."""
        request = WriteMultipleRegistersRequest(dev_id=_slave(device_id), address=address, registers=list(values))
        await self._ask(request, deadline, lambda r, d: checks.echoed(r, address, values, d), again=idempotent)

    async def readwrite_registers(
        self,
        device_id: int,
        write: tuple[int, Sequence[int]],
        read: tuple[int, int],
        deadline: Deadline,
        *,
        idempotent: bool = True,
    ) -> tuple[int, ...]:
        """Write (address, values) and then read (address, count) in one transaction (FC 23)."""
        request = ReadWriteMultipleRegistersRequest(
            read_address=read[0],
            read_count=read[1],
            write_address=write[0],
            write_registers=list(write[1]),
            dev_id=_slave(device_id),
        )
        return await self._ask(request, deadline, lambda r, d: checks.registers(r, read[1], d), again=idempotent)

    async def read_coils(self, device_id: int, address: int, count: int, deadline: Deadline) -> tuple[bool, ...]:
        """Read `count` coils (FC 1)."""
        request = ReadCoilsRequest(dev_id=_slave(device_id), address=address, count=count)
        return await self._ask(request, deadline, lambda r, d: checks.coils(r, count, d))

    async def write_coils(self, device_id: int, address: int, values: Sequence[bool], deadline: Deadline) -> None:
        """Write coils as levels in one request (FC 15)."""
        request = WriteMultipleCoilsRequest(dev_id=_slave(device_id), address=address, bits=list(values))
        await self._ask(request, deadline, lambda r, d: checks.echoed(r, address, values, d))

    # ------------------------------------------------------------------ object dictionary
    async def od_read(
        self,
        device_id: int,
        entry: od.OdEntry,
        deadline: Deadline,
        addressing: od.OdAddressing = od.USUAL,
    ) -> int:
        """Read one object (FC 43/13); raise DeviceRefused with the abort code."""
        telegram = od.read_request(entry, addressing)

        def value(reply: ModbusPDU, device: str) -> int:
            try:
                return od.read_value(telegram, checks.od_telegram(reply, device), signed=entry.signed)
            except ValueError as exc:
                raise ReplyError(f"{entry}: {exc}", device=device) from exc

        return await self._ask(OdPdu(telegram.encode(), _slave(device_id)), deadline, value)

    async def od_write(
        self,
        device_id: int,
        entry: od.OdEntry,
        value: int,
        deadline: Deadline,
        addressing: od.OdAddressing = od.USUAL,
    ) -> None:
        """Write one object (FC 43/13); raise DeviceRefused with the abort code."""
        telegram = od.write_request(entry, value, addressing)

        def check(reply: ModbusPDU, device: str) -> None:
            try:
                od.check_write_reply(telegram, checks.od_telegram(reply, device))
            except ValueError as exc:
                raise ReplyError(f"{entry}: {exc}", device=device) from exc

        await self._ask(OdPdu(telegram.encode(), _slave(device_id)), deadline, check, od_write=True)

    # ------------------------------------------------------------------ how a request is made
    async def _ask(
        self,
        request: ModbusPDU,
        deadline: Deadline,
        take: Callable[[ModbusPDU, str], T],
        *,
        again: bool = True,
        od_write: bool = False,
    ) -> T:
        """Try a request, again if allowed, until it has a fitting reply, the tries are used up or time is over."""
        tries = self._timing.attempts if again else 1
        while True:
            tries -= 1
            try:
                return await self._attempt(request, deadline, take, od_write=od_write)
            except DeadlinePassed:
                raise
            except (LinkTimeout, ReplyError) as exc:
                if tries == 0 or deadline.expired:
                    raise
                self.statistics.retries += 1
                self._log.debug("bus.retry", slave=request.dev_id, fc=request.function_code, cause=str(exc))

    async def _attempt(
        self, request: ModbusPDU, deadline: Deadline, take: Callable[[ModbusPDU, str], T], *, od_write: bool
    ) -> T:
        device = self._device(request.dev_id)
        if deadline.expired:
            raise DeadlinePassed(f"no time left for FC {request.function_code}", device=device)
        try:
            async with asyncio.timeout(deadline.remaining_s):
                await self._lock.acquire()
                task = asyncio.create_task(self._on_wire(request, take, device, od_write=od_write))
                self._open_requests.add(task)
                task.add_done_callback(self._over)
                return take(await asyncio.shield(task), device)
        except LinkTimeout:
            raise
        except TimeoutError as exc:
            text = f"deadline passed during FC {request.function_code}"
            raise DeadlinePassed(text, device=device) from exc

    def _over(self, task: asyncio.Task[ModbusPDU]) -> None:
        self._open_requests.discard(task)
        self._lock.release()

    async def _on_wire(
        self, request: ModbusPDU, take: Callable[[ModbusPDU, str], object], device: str, *, od_write: bool
    ) -> ModbusPDU:
        """Do one exchange with the lock held; on failure keep the line until a late reply cannot come."""
        if self._closed:
            raise LinkError("the line is closed", device=device)
        await self._link.connect()
        await asyncio.sleep(max(0.0, self._free_at_s - time.monotonic()))
        self.statistics.requests += 1
        try:
            reply = checks.sound_reply(request, await self._link.exchange(request, device, od_write=od_write), device)
            take(reply, device)
            return reply
        except DeviceRefused:
            self.statistics.refused += 1
            raise
        except (LinkError, ReplyError) as exc:
            self.statistics.timeouts += isinstance(exc, LinkTimeout)
            self.statistics.garbled += isinstance(exc, ReplyError)
            await self._link.quiet()
            raise
        finally:
            self._free_at_s = time.monotonic() + self._timing.gap_s


def _slave(device_id: int) -> int:
    """Check a slave address; 255 is what some relay boards ship with. Broadcasts (0) have no answer."""
    if not 1 <= device_id <= 247 and device_id != 255:
        raise ValueError(f"slave address {device_id} is not 1..247 (or 255)")
    return device_id
