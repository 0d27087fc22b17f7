"""One drive on the bus: its object dictionary by FC 43, its process image by FC 3 and FC 23."""

from collections.abc import Iterator
from contextlib import contextmanager

from drivers.bus import ModbusBus, OdAddressing, OdEntry
from drivers.deadline import Deadline
from drivers.errors import DeviceError, DeviceRefused, ReplyError
from drivers.l4118 import objects as od
from drivers.l4118.contract import AxisConfig, AxisStatus
from drivers.l4118.image import RX_ADDRESS, RX_WANTED, TX_ADDRESS, TX_WANTED, Layout, WordOrder, parse


def key(entry: OdEntry) -> int:
    """Give the key of an object in a `Layout`."""
    return entry.index << 8 | entry.subindex


class DriveAccess:
    """Reads and writes of one drive; what the self-test settles is kept here.

    The Rx image is always written as a whole and holds levels only, so writing it twice is the same as writing
    it once: the bus may repeat it after a lost reply. What the line or the drive raises says which axis it is about,
    and which object where one was asked for.
    """

    def __init__(self, bus: ModbusBus, config: AxisConfig) -> None:
        self.config = config
        self.addressing = config.addressing or OdAddressing()
        self.word_order: WordOrder = "big" if config.word_order == "auto" else config.word_order
        self.tx: Layout = parse(TX_WANTED)
        self.rx: Layout = parse(RX_WANTED)
        self.target_increments = 0
        self.velocity_counts = 0
        self._bus = bus
        bus.label(config.address, config.name)

    async def read(self, entry: OdEntry, deadline: Deadline, addressing: OdAddressing | None = None) -> int:
        """Read one object."""
        with self._about(entry):
            return await self._bus.od_read(self.config.address, entry, deadline, addressing or self.addressing)

    async def read_if_there(self, entry: OdEntry, deadline: Deadline) -> int | None:
        """Read one object, or give None when the drive has no such object or nothing in it."""
        try:
            return await self.read(entry, deadline)
        except DeviceRefused as exc:
            if exc.code in (od.ABORT_NO_OBJECT, od.ABORT_NO_SUBINDEX, od.ABORT_EMPTY_STACK):
                return None
            raise

    async def write(self, entry: OdEntry, value: int, deadline: Deadline) -> None:
        """Write one object."""
        with self._about(entry):
            await self._bus.od_write(self.config.address, entry, value, deadline, self.addressing)

    async def write_checked(self, entry: OdEntry, value: int, deadline: Deadline) -> None:
        """Write one object and read it back; raise ReplyError when the drive kept another value."""
        await self.write(entry, value, deadline)
        kept = await self.read(entry, deadline)
        if kept != value:
            text = f"{entry} was written as {value} and reads {kept}"
            with self._about(entry):
                raise ReplyError(text, device=self.config.name, advice="Check the FC 43 settings of this drive.")

    async def alive(self, deadline: Deadline) -> None:
        """Read two registers of the Tx image, to tell a silent drive from one that refuses FC 43."""
        with self._about():
            await self._bus.read_registers(self.config.address, TX_ADDRESS, 2, deadline)

    async def status(self, deadline: Deadline) -> AxisStatus:
        """Read the Tx image."""
        count = self.tx.register_count
        with self._about():
            return self._decode(await self._bus.read_registers(self.config.address, TX_ADDRESS, count, deadline))

    async def command(self, control: int, deadline: Deadline) -> AxisStatus:
        """Write the Rx image with this control word and read the Tx image, in one transaction.

        The status may still be the one from before the command: poll on.
        """
        values = {
            key(od.CONTROLWORD): control,
            key(od.TARGET_POSITION): self.target_increments,
            key(od.PROFILE_VELOCITY): self.velocity_counts,
        }
        registers = self.rx.registers(values, self.word_order)
        read = (TX_ADDRESS, self.tx.register_count)
        with self._about():
            return self._decode(
                await self._bus.readwrite_registers(self.config.address, (RX_ADDRESS, registers), read, deadline)
            )

    @contextmanager
    def _about(self, entry: OdEntry | None = None) -> Iterator[None]:
        """Let an error say which axis, and which object, it is about."""
        try:
            yield
        except DeviceError as exc:
            exc.axis, exc.object = self.config.name, entry.place if entry else None
            raise

    def _decode(self, registers: tuple[int, ...]) -> AxisStatus:
        order, tx = self.word_order, self.tx
        position = tx.value(registers, key(od.POSITION_ACTUAL), order, signed=True)
        return AxisStatus(
            statusword=tx.value(registers, key(od.STATUSWORD), order),
            mode=tx.value(registers, key(od.MODE_DISPLAY), order, signed=True),
            position_units=self.config.to_units(position),
            inputs=tx.value(registers, key(od.DIGITAL_INPUTS), order),
        )
