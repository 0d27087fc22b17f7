"""Stream to an instrument, opened by its address: a TCP connection, or a serial port read without blocking the loop."""

from __future__ import annotations

import asyncio
import errno
import os
import socket
import termios
from functools import partial
from typing import Protocol

import serial

from drivers.deadline import Deadline
from drivers.errors import MeterError, MeterTimeout, MeterTrouble
from drivers.meter.contract import SerialAddress, TcpAddress
from drivers.meter.lines import Lines

_PIECE = 4096


class Stream(Protocol):
    """What is open: it feeds the lines it was opened with, and tells them of its end."""

    def write(self, data: bytes) -> None:
        """Send bytes. Raises OSError when they do not go out."""

    def close(self) -> None:
        """Close it at once; safe to call twice."""


async def open_stream(address: TcpAddress | SerialAddress, baudrate: int, lines: Lines, deadline: Deadline) -> Stream:
    """Open by TCP or as a serial port (8N1, exclusive); raise MeterError that says why it cannot be."""
    if isinstance(address, TcpAddress):
        return await _open_tcp(address, lines, deadline)
    return await _open_serial(address, baudrate, lines, deadline)


class _TcpStream(asyncio.Protocol):
    def __init__(self, lines: Lines) -> None:
        self._lines = lines
        self._transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)  # noqa: S101 - for the type checker; TCP gives no other
        self._transport = transport
        sock = transport.get_extra_info("socket")
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)

    def data_received(self, data: bytes) -> None:
        self._lines.feed(data)

    def connection_lost(self, exc: Exception | None) -> None:
        self._lines.end(str(exc) if exc else "the instrument closed the connection")

    def write(self, data: bytes) -> None:
        if self._transport is None or self._transport.is_closing():
            raise ConnectionError("the connection is closed")
        self._transport.write(data)

    def close(self) -> None:
        if self._transport is not None:
            self._transport.abort()


async def _open_tcp(address: TcpAddress, lines: Lines, deadline: Deadline) -> Stream:
    loop = asyncio.get_running_loop()
    try:
        async with asyncio.timeout(deadline.remaining_s):
            found = await loop.getaddrinfo(address.host, address.port, type=socket.SOCK_STREAM)
            for number, (family, _, proto, _, place) in enumerate(found, start=1):
                try:
                    _, stream = await loop.create_connection(
                        lambda: _TcpStream(lines), str(place[0]), address.port, family=family, proto=proto
                    )
                except OSError:
                    if number == len(found):
                        raise
                else:
                    return stream
    except (socket.gaierror, UnicodeError) as exc:
        raise MeterError(f"no such host: {address.host}", MeterTrouble.ADDRESS) from exc
    except TimeoutError as exc:
        raise MeterTimeout(f"no connection to {address} in time", MeterTrouble.UNREACHABLE) from exc
    except PermissionError as exc:
        error = MeterError(f"may not connect to {address}", MeterTrouble.UNREACHABLE)
        error.advice = "Allow the service this address: systemctl edit reprobe, with IPAddressAllow= under [Service]."
        raise error from exc
    except OSError as exc:
        refused = exc.errno in (errno.ECONNREFUSED, errno.ECONNRESET)
        trouble = MeterTrouble.REFUSED if refused else MeterTrouble.UNREACHABLE
        raise MeterError(f"cannot connect to {address}: {exc.strerror or exc}", trouble) from exc
    raise MeterError(f"no such host: {address.host}", MeterTrouble.ADDRESS)


class _SerialStream:
    def __init__(self, port: serial.Serial, lines: Lines) -> None:
        self._port = port
        self._lines = lines
        self._loop = asyncio.get_running_loop()
        self._fd: int | None = port.fileno()
        self._loop.add_reader(self._fd, self._readable)

    def _readable(self) -> None:
        assert self._fd is not None  # noqa: S101 - the reader is removed where it becomes None
        try:
            data = os.read(self._fd, _PIECE)
        except (BlockingIOError, InterruptedError):
            return
        except OSError as exc:
            self._gone(exc.strerror or str(exc))
            return
        if data:
            self._lines.feed(data)
        else:
            self._gone("the port was unplugged")

    def _gone(self, why: str) -> None:
        self._lines.end(why)
        self.close()

    def write(self, data: bytes) -> None:
        if self._fd is None:
            raise ConnectionError("the port is closed")
        if os.write(self._fd, data) != len(data):
            raise ConnectionError("the port takes no more: flow control holds it")

    def close(self) -> None:
        if self._fd is not None:
            self._loop.remove_reader(self._fd)
            self._fd = None
            self._port.close()


async def _open_serial(address: SerialAddress, baudrate: int, lines: Lines, deadline: Deadline) -> Stream:
    make = partial(serial.Serial, address.port, baudrate, timeout=0, write_timeout=0, exclusive=True)
    opening = asyncio.get_running_loop().run_in_executor(None, make)
    try:
        async with asyncio.timeout(deadline.remaining_s):
            port = await asyncio.shield(opening)
    except TimeoutError as exc:
        opening.add_done_callback(_close_late)
        raise MeterTimeout(f"{address} does not open in time", MeterTrouble.UNREACHABLE) from exc
    except asyncio.CancelledError:
        opening.add_done_callback(_close_late)
        raise
    except (OSError, ValueError, termios.error) as exc:
        raise _not_opened(address, exc) from exc
    return _SerialStream(port, lines)


def _close_late(opening: asyncio.Future[serial.Serial]) -> None:
    """Close a port that opened when nobody waited for it any more."""
    if not opening.cancelled() and opening.exception() is None:
        opening.result().close()


def _not_opened(address: SerialAddress, exc: BaseException) -> MeterError:
    number = exc.errno if isinstance(exc, OSError) else None
    if number == errno.ENOENT:
        return MeterError(f"there is no {address}", MeterTrouble.ADDRESS)
    if number in (errno.EAGAIN, errno.EBUSY):
        return MeterError(f"{address} is held by another program", MeterTrouble.BUSY)
    error = MeterError(f"{address} cannot be opened: {exc}", MeterTrouble.ADDRESS)
    if number in (errno.EACCES, errno.EPERM):
        error.advice = "Let this user open serial ports: add it to the group that owns the port (dialout on most)."
    return error
