"""One Modbus line: one request at a time, each finished before the next, whatever the callers do."""

import asyncio
import time
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from typing import Self, TypeVar

import structlog
from pymodbus.pdu import ModbusPDU
from pymodbus.pdu.bit_message import ReadCoilsRequest, WriteMultipleCoilsRequest, WriteSingleCoilRequest
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadInputRegistersRequest,
    WriteMultipleRegistersRequest,
)

from drivers.bus import checks, od
from drivers.bus.contract import BusTiming, Line
from drivers.bus.link import ByteTap, Link
from drivers.bus.pdus import OdPdu
from drivers.deadline import Deadline
from drivers.errors import DeadlinePassed, DeviceRefused, LinkError, LinkTimeout, ReplyError

T = TypeVar("T")
# Bytes of reading one 32 bit object by FC 43, there and back, and what a slave may take to think
OBJECT_BYTES, THOUGHT_S = 33, 0.005


@dataclass(slots=True)
class BusStatistics:
    """What happened on the line since it was opened."""

    requests: int = 0
    timeouts: int = 0
    lost: int = 0
    """How often the port was gone when a request wanted to go out, or went while its reply was awaited."""
    garbled: int = 0
    refused: int = 0
    busy: int = 0
    """How often a slave asked for patience (exceptions 05 and 06)."""
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
        # Slaves and the function codes that they do not know
        self._lacking: set[tuple[int, int]] = set()
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
    def missing_answers(self) -> int:
        """Count the requests that had no answer, or none that made sense, and how often the line was lost."""
        return self.statistics.timeouts + self.statistics.garbled + self.statistics.lost

    @property
    def request_s(self) -> float:
        """Tell how long asking for one object takes, with its bytes at this line's speed and a slave's thought."""
        return self._timing.gap_s + THOUGHT_S + self._link.line.seconds(OBJECT_BYTES)

    @property
    def reconnects(self) -> int:
        """Count how often the lost port was opened again."""
        return self._link.reconnects

    # ------------------------------------------------------------------ registers and coils
    async def read_registers(self, device_id: int, address: int, count: int, deadline: Deadline) -> tuple[int, ...]:
        """Read `count` registers (FC 3, or FC 4 on a slave that has only that)."""

        async def ask(kind: type[ReadHoldingRegistersRequest] | type[ReadInputRegistersRequest]) -> tuple[int, ...]:
            request = kind(dev_id=_slave(device_id), address=address, count=count)
            return await self._ask(request, deadline, lambda r, d: checks.registers(r, count, d))

        usual, other = ReadHoldingRegistersRequest, ReadInputRegistersRequest
        return await self._either((device_id, usual.function_code), lambda: ask(usual), lambda: ask(other))

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

    async def read_coils(self, device_id: int, address: int, count: int, deadline: Deadline) -> tuple[bool, ...]:
        """Read `count` coils (FC 1)."""
        request = ReadCoilsRequest(dev_id=_slave(device_id), address=address, count=count)
        return await self._ask(request, deadline, lambda r, d: checks.coils(r, count, d))

    async def write_coils(self, device_id: int, address: int, values: Sequence[bool], deadline: Deadline) -> None:
        """Write coils as levels in one request (FC 15), or one by one (FC 5) on a slave that lacks it.

        One by one, what goes off goes off first.
        """

        async def together() -> None:
            request = WriteMultipleCoilsRequest(dev_id=_slave(device_id), address=address, bits=list(values))
            await self._ask(request, deadline, lambda r, d: checks.coils_echoed(r, address, values, d))

        async def one_by_one() -> None:
            for place, level in sorted(enumerate(values, address), key=lambda coil: coil[1]):
                await self._write_coil(device_id, place, level, deadline)

        key = (device_id, WriteMultipleCoilsRequest.function_code)
        await self._either(key, together, one_by_one)

    async def _write_coil(self, device_id: int, address: int, level: bool, deadline: Deadline) -> None:  # noqa: FBT001
        request = WriteSingleCoilRequest(dev_id=_slave(device_id), address=address, bits=[level])
        await self._ask(request, deadline, lambda r, d: checks.coil_echoed(r, address, level, d))

    async def _either(
        self, key: tuple[int, int], usual: Callable[[], Awaitable[T]], other: Callable[[], Awaitable[T]]
    ) -> T:
        """Ask in the usual way; a slave that does not know its function code is asked in the other from then on."""
        if key not in self._lacking:
            try:
                return await usual()
            except DeviceRefused as exc:
                if exc.code != checks.ILLEGAL_FUNCTION:
                    raise
                lacks = exc
            self._log.info("bus.function_code_missing", slave=key[0], fc=key[1])
            try:
                result = await other()
            except DeviceRefused as exc:
                raise lacks from exc
            self._lacking.add(key)
            return result
        return await other()

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
                raise ReplyError(checks.FOREIGN, device=device, technical=f"{entry}: {exc}") from exc

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
                raise ReplyError(checks.FOREIGN, device=device, technical=f"{entry}: {exc}") from exc

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
        """Try a request, again if allowed, until it has a fitting reply, the tries are used up or time is over.

        A slave that is busy (exceptions 05 and 06) is asked until it is not, or time is over.
        """
        tries = self._timing.attempts if again else 1
        wait_s = self._timing.busy_s
        while True:
            try:
                return await self._attempt(request, deadline, take, od_write=od_write)
            except DeadlinePassed:
                raise
            except DeviceRefused as exc:
                if exc.code not in (checks.BUSY if again else checks.NOT_DONE) or wait_s >= deadline.remaining_s:
                    raise
                self.statistics.refused -= 1
                self.statistics.busy += 1
                self._log.debug("bus.busy", slave=request.dev_id, fc=request.function_code, cause=str(exc))
                await asyncio.sleep(wait_s)
                wait_s = min(2 * wait_s, self._timing.busy_max_s)
            except (LinkTimeout, ReplyError) as exc:
                tries -= 1
                if tries == 0 or deadline.expired:
                    raise
                self.statistics.retries += 1
                self._log.debug("bus.retry", slave=request.dev_id, fc=request.function_code, cause=str(exc))

    async def _attempt(
        self, request: ModbusPDU, deadline: Deadline, take: Callable[[ModbusPDU, str], T], *, od_write: bool
    ) -> T:
        device = self._device(request.dev_id)
        if deadline.expired:
            raise DeadlinePassed("no time was left to ask it", device=device, technical=f"FC {request.function_code}")
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
            technical = f"FC {request.function_code}"
            raise DeadlinePassed("deadline passed before it answered", device=device, technical=technical) from exc

    def _over(self, task: asyncio.Task[ModbusPDU]) -> None:
        self._open_requests.discard(task)
        self._lock.release()
        if not task.cancelled():
            task.exception()  # its caller may have gone: then nobody else asks how it ended

    async def _on_wire(
        self, request: ModbusPDU, take: Callable[[ModbusPDU, str], object], device: str, *, od_write: bool
    ) -> ModbusPDU:
        """Do one exchange with the lock held; on failure keep the line until a late reply cannot come."""
        if self._closed:
            raise LinkError("the line is closed", device=device)
        try:
            await self._link.connect()
        except LinkError:
            self.statistics.lost += 1
            raise
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
            self.statistics.lost += isinstance(exc, LinkError) and not isinstance(exc, LinkTimeout)
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
