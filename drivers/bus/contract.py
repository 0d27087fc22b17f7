"""What a line is, and how long things may take on it."""

from dataclasses import dataclass
from typing import Literal

# What a line behind a gateway is taken for: its speed is not known here
_GATEWAY_BAUD = 9600


@dataclass(frozen=True, slots=True)
class SerialLine:
    """A Modbus RTU line on a serial port (RS-485 adapter, or a pty).

    Stop bits follow the parity on the drives: none -> 2 by the drive manual, 1 where the line says so.
    """

    port: str
    baudrate: int = 19200
    parity: Literal["N", "E", "O"] = "E"
    stop_bits: Literal[1, 2] = 1
    local_echo: bool = False
    """The adapter hears what it sends; the echo is taken away before the reply is read."""

    def __str__(self) -> str:
        return f"{self.port} {self.baudrate} 8{self.parity}{self.stop_bits}"

    def seconds(self, size: int) -> float:
        """Give how long `size` bytes take."""
        return size * (9 + (self.parity != "N") + self.stop_bits) / self.baudrate


@dataclass(frozen=True, slots=True)
class TcpLine:
    """Modbus TCP, or RTU frames over TCP (a serial gateway in transparent mode)."""

    host: str
    port: int = 502
    framing: Literal["tcp", "rtu"] = "tcp"

    def __str__(self) -> str:
        return f"{self.framing}://{self.host}:{self.port}"

    def seconds(self, size: int) -> float:
        """Give how long `size` bytes take; behind a gateway there may be a line of the slowest usual speed."""
        return size * 11 / _GATEWAY_BAUD


Line = SerialLine | TcpLine


@dataclass(frozen=True, slots=True)
class BusTiming:
    """Times of one line, in seconds, and how often a request is tried."""

    gap_s: float = 0.003
    """Silence after a response before the next request; the drives want 3 ms when several share a line."""
    timeout_s: float = 0.2
    """How long one reply may take."""
    late_reply_s: float = 0.4
    """After this no reply to an old request can still arrive; a failed request keeps the line until then."""
    attempts: int = 3
    """How often a read or an idempotent write is tried in all."""
    busy_s: float = 0.02
    """First wait before a busy slave (exceptions 05 and 06) is asked again; doubles up to `busy_max_s`."""
    busy_max_s: float = 0.2
    reconnect_s: float = 0.1
    """First wait before opening a lost port again; doubles up to `reconnect_max_s`."""
    reconnect_max_s: float = 2.0

    def __post_init__(self) -> None:
        if self.late_reply_s < self.timeout_s:
            raise ValueError("late_reply_s must not be shorter than timeout_s")
        if self.attempts < 1:
            raise ValueError("attempts must be at least 1")
