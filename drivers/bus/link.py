"""The connection under a bus: open, reopen with back-off, one request at a time, quiet after a failure.

The only file that touches the client library; none of its exceptions (nor termios') leaves it.
"""

import asyncio
import contextlib
import errno
import os
import termios
import time
import traceback
from collections.abc import Callable, Coroutine
from typing import Any, Literal, cast

import structlog
from pymodbus.client import AsyncModbusSerialClient, AsyncModbusTcpClient
from pymodbus.exceptions import ConnectionException, ModbusException
from pymodbus.framer import FramerRTU, FramerType
from pymodbus.pdu import ModbusPDU

from drivers.bus import od
from drivers.bus.contract import BusTiming, Line, SerialLine
from drivers.bus.pdus import Expectation, HuntingRtuFramer, ReplyDecoder
from drivers.errors import LinkError, LinkTimeout, ReplyError

Client = AsyncModbusSerialClient | AsyncModbusTcpClient
ByteTap = Callable[[Literal["sent", "received"], bytes], None]

# More silent requests than anyone will make: when to give up a connection is decided here, not in the library.
_NEVER = 1_000_000_000
# Bytes of the shortest RTU frame: address, function code, CRC
_SHORTEST_FRAME = 4


class Link:
    """One client of the library and the state of its connection. Belongs to one event loop."""

    def __init__(self, line: Line, timing: BusTiming, tap: ByteTap | None = None) -> None:
        self.line = line
        self.reconnects = 0
        self._timing = timing
        self._tap = tap
        self._log = structlog.get_logger().bind(device=str(line))
        self._expect = Expectation()
        self._heard = 0
        self._sent = b""
        self._echoed = False
        self._sent_at_s = 0.0
        self._next_try_s = 0.0
        self._backoff_s = timing.reconnect_s
        self._was_up = False
        self._outage = False
        self._cause: BaseException | None = None
        self._client = self._make_client()

    # ------------------------------------------------------------------ connection
    async def connect(self) -> None:
        """Make sure the line is open; raise LinkError at once while the back-off of a lost line runs."""
        if self._client.connected:
            return
        wait_s = self._next_try_s - time.monotonic()
        if wait_s > 0:
            raise self._broken(f"not connected; next try in {wait_s:.1f} s")
        if self._was_up and not self._outage:
            self._outage = True
            self._log.error("link.lost")
        self._cause = None
        if not await self._client.connect():
            self._next_try_s = time.monotonic() + self._backoff_s
            self._backoff_s = min(2 * self._backoff_s, self._timing.reconnect_max_s)
            self._log.debug("link.reopen_failed", cause=str(self._cause))
            raise self._broken("cannot be opened") from self._cause
        self._backoff_s = self._timing.reconnect_s
        if self._was_up:
            self.reconnects += 1
            self._log.info("link.back")
        self._was_up, self._outage = True, False
        self._flush()

    @property
    def connected(self) -> bool:
        """Tell whether the line is open as far as the system knows."""
        return bool(self._client.connected)

    def close(self) -> None:
        """Close the line; safe to call twice."""
        self._client.close()

    # ------------------------------------------------------------------ one request
    async def exchange(self, request: ModbusPDU, device: str, *, od_write: bool = False) -> ModbusPDU:
        """Send one request and give the first sound reply of its slave, whatever it says.

        Raises LinkTimeout (silence), ReplyError (bytes, but no sound frame), LinkError (line lost).
        """
        self._expect.device_id, self._expect.od_write = request.dev_id, od_write
        self._heard = 0
        self._sent_at_s = time.monotonic()
        try:
            reply = await self._client.execute(no_response_expected=False, request=request)
            self._heard = 0
            if self._echoed:
                raise self._hears_itself(device)
            return cast("ModbusPDU", reply)
        except ConnectionException as exc:
            raise self._broken("connection lost") from exc
        except (ModbusException, OSError, termios.error) as exc:
            raise self._silence(request, device) from exc

    async def quiet(self) -> None:
        """Wait until no reply to the failed request can come any more, then throw away what came."""
        over_s = self._sent_at_s + self._timing.late_reply_s
        await asyncio.sleep(max(0.0, over_s - time.monotonic()))
        self._flush()

    @staticmethod
    def _hears_itself(device: str) -> ReplyError:
        advice = "Set local_echo = true for this bus, or switch the adapter's echo off (its receiver while it sends)."
        return ReplyError(
            "the adapter hears itself: the request came back before the reply", device=device, advice=advice
        )

    def _silence(self, request: ModbusPDU, device: str) -> LinkError | ReplyError:
        if not self._client.connected:
            return self._broken("connection lost")
        if self._echoed:
            return self._hears_itself(device)
        rest = self._client.ctx.recv_buffer
        if rest:
            technical = f"no sound frame in the reply to FC {request.function_code}: {rest[:40].hex(' ')}"
            return ReplyError("its answer was garbled on the line", device=device, technical=technical)
        text = f"no answer within {self._timing.timeout_s * 1000:.0f} ms"
        return LinkTimeout(text, device=device, technical=f"FC {request.function_code}")

    def _broken(self, text: str) -> LinkError:
        cause = f" ({_in_words(self._cause)})" if self._cause is not None else ""
        return LinkError(text + cause, device=str(self.line), advice=_advice(self._cause))

    def _flush(self) -> None:
        # Reaching into the library: it has no call for this, and without it a late reply answers the next request.
        port = getattr(self._client.ctx.transport, "sync_serial", None)
        if port is not None:
            with contextlib.suppress(OSError, termios.error):
                port.reset_input_buffer()
        self._client.ctx.recv_buffer = b""
        self._client.ctx.sent_buffer = b""
        self._heard = 0

    # ------------------------------------------------------------------ the library's client
    def _make_client(self) -> Client:
        common: dict[str, Any] = {
            "timeout": self._timing.timeout_s,
            "retries": 0,
            "reconnect_delay": 0,
            "trace_packet": self._trace,
        }
        line = self.line
        client: Client
        if isinstance(line, SerialLine):
            client = AsyncModbusSerialClient(
                line.port,
                framer=FramerType.RTU,
                baudrate=line.baudrate,
                parity=line.parity,
                stopbits=line.stop_bits,
                handle_local_echo=line.local_echo,
                **common,
            )
        else:
            framer = FramerType.SOCKET if line.framing == "tcp" else FramerType.RTU
            client = AsyncModbusTcpClient(line.host, port=line.port, framer=framer, **common)
        client.set_max_no_responses(_NEVER)
        decoder = ReplyDecoder()
        if isinstance(client.ctx.framer, FramerRTU):
            client.ctx.framer = HuntingRtuFramer(decoder, self._expect)
        else:
            client.ctx.framer.decoder = decoder
        client.ctx.call_create = self._remembering(client.ctx.call_create)
        return client

    def _remembering(self, create: Callable[[], Coroutine[Any, Any, Any]]) -> Callable[[], Coroutine[Any, Any, Any]]:
        """Wrap the library's opening of the port, which would lose the cause or let termios.error through."""

        async def open_port() -> Any:
            try:
                return await create()
            except (OSError, termios.error, ValueError) as exc:
                # What the library opened and could not set it leaves to its frames, with the port's lock: the next try
                # would find the port held by somebody, which is itself
                traceback.clear_frames(exc.__traceback__)
                self._cause = exc
                raise OSError(str(exc)) from exc

        return open_port

    def _trace(self, sending: bool, data: bytes) -> bytes:  # noqa: FBT001 - the library's signature
        # On reception the library shows all bytes since the request, each time: only the new ones go on.
        if self._tap is not None:
            if sending:
                self._tap("sent", data)
            else:
                self._tap("received", data[self._heard :])
        self._heard = 0 if sending else len(data)
        if sending:
            self._sent, self._echoed = data, False
        else:
            self._echoed = _is_echo(self._sent, data)
        return data


def _is_echo(request: bytes, heard: bytes) -> bool:
    """Tell whether what was heard is an RTU request itself, alone or with its reply behind it.

    A reply may begin like its request by chance, where a value is the request's CRC, but is hardly longer then. A reply
    to a write may be the same as the request.
    """
    function = request[1] if len(request) > _SHORTEST_FRAME else 0
    reads = function in (1, 3, 4) or (function == od.FUNCTION_CODE and request[3] == 0)
    behind = len(heard) - len(request)
    return reads and heard.startswith(request) and (behind == 0 or behind > _SHORTEST_FRAME)


def _in_words(cause: BaseException) -> str:
    """Return what the system says, once: a port's own error repeats number and path."""
    number = cause.errno if isinstance(cause, OSError) else None
    if number == errno.EAGAIN:
        return "it is locked"
    return os.strerror(number) if number else str(cause)


def _advice(cause: BaseException | None) -> str | None:
    if isinstance(cause, FileNotFoundError) or "No such file" in str(cause):
        return "Plug in the adapter, or correct the port in the configuration."
    if isinstance(cause, termios.error):
        return "The port does not support this parity or speed; use parity N on a pseudo terminal."
    if "lock" in str(cause):
        return "Another program holds the port; stop it first."
    if isinstance(cause, PermissionError) or "Permission" in str(cause):
        return "Add the service's user to the group of the port (dialout)."
    return None
