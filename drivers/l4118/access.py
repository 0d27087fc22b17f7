"""One drive on the bus: its object dictionary by FC 43, its status image by FC 3."""

from collections.abc import Iterator
from contextlib import contextmanager

from drivers.bus import ModbusBus, OdAddressing, OdEntry
from drivers.deadline import Deadline
from drivers.errors import DeviceError, DeviceRefused, ReplyError
from drivers.l4118 import objects as od
from drivers.l4118.contract import AxisConfig, AxisStatus
from drivers.l4118.image import TX_ADDRESS, TX_WANTED, Layout, WordOrder, order_shown, parse


def key(entry: OdEntry) -> int:
    """Give the key of an object in a `Layout`."""
    return entry.index << 8 | entry.subindex


class DriveAccess:
    """Reads and writes of one drive; what the self-test settles is kept here.

    Everything is written by FC 43, each object by its own number. The process image is only read: a drive that has just
    restarted has its own mapping in force, and what is written into the image would land in other objects. All that
    is written are levels, so writing one twice is the same as once: the bus may repeat it after a lost reply.

    What the line or the drive raises says which axis it is about, and which object where one was asked for.
    """

    def __init__(self, bus: ModbusBus, config: AxisConfig) -> None:
        self.config = config
        self.addressing = config.addressing or OdAddressing()
        self.word_order: WordOrder | None = None
        """Order of the words of a 32 bit value in the image; None until a value has shown it."""
        self.tx: Layout = parse(TX_WANTED)
        self._velocity_kept: int | None = None
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
            technical = f"{entry} was written as {value} and reads {kept}"
            text = "the drive did not keep a value that it was given"
            advice = "Check object_access of this axis in the configuration, and the drive's model."
            with self._about(entry):
                raise ReplyError(text, device=self.config.name, advice=advice, technical=technical)

    async def ensure(self, entry: OdEntry, value: int, deadline: Deadline) -> None:
        """See that one object holds a value: read it, and only where it differs write it and read it back.

        A daemon that starts anew finds what the one before it wrote, and has asked half as much.
        """
        if await self.read(entry, deadline) != value:
            await self.write_checked(entry, value, deadline)

    async def alive(self, deadline: Deadline) -> None:
        """Read two registers of the Tx image, to tell a silent drive from one that refuses FC 43."""
        with self._about():
            await self._bus.read_registers(self.config.address, TX_ADDRESS, 2, deadline)

    async def image(self, deadline: Deadline) -> tuple[int, ...]:
        """Read the registers of the Tx image."""
        with self._about():
            return await self._bus.read_registers(self.config.address, TX_ADDRESS, self.tx.register_count, deadline)

    async def status(self, deadline: Deadline) -> AxisStatus:
        """Read the Tx image, and what it tells."""
        return await self.status_in(await self.image(deadline), deadline)

    async def status_in(self, registers: tuple[int, ...], deadline: Deadline) -> AxisStatus:
        """Tell what an image says; a long value whose word order no value has shown yet is read by FC 43."""
        position = await self._long(registers, od.POSITION_ACTUAL, deadline)
        return AxisStatus(
            statusword=self.tx.value(registers, key(od.STATUSWORD), "big"),
            mode=self.tx.value(registers, key(od.MODE_DISPLAY), "big", signed=True),
            position_units=self.config.to_units(position),
            inputs=await self._long(registers, od.DIGITAL_INPUTS, deadline),
        )

    async def statusword(self, deadline: Deadline) -> int:
        """Read 6041h by FC 43: right whatever lies in the image."""
        return await self.read(od.STATUSWORD, deadline)

    async def command(self, control: od.Control, deadline: Deadline) -> None:
        """Write the controlword."""
        await self.write(od.CONTROLWORD, control, deadline)

    async def aim(self, target_increments: int, velocity_counts: int, deadline: Deadline) -> None:
        """Write the target of the next set-point, and its speed where that changed."""
        await self.write(od.TARGET_POSITION, target_increments, deadline)
        if self._velocity_kept != velocity_counts:
            await self.set_velocity(velocity_counts, deadline)

    async def set_velocity(self, counts: int, deadline: Deadline) -> None:
        """Write the profile velocity of the moves to come (6081h); it is written again only where it changes."""
        self._velocity_kept = None
        await self.write(od.PROFILE_VELOCITY, counts, deadline)
        self._velocity_kept = counts

    def forget(self) -> None:
        """Forget what was found out before: the drive may have restarted since."""
        self.word_order = self._velocity_kept = None

    def note_word_order(self, order: WordOrder) -> None:
        """Keep the order that a value has shown; raise ReplyError when the configuration says another."""
        if self.config.word_order not in ("auto", order):
            text = f"word order is {order}, the configuration says {self.config.word_order}"
            raise ReplyError(text, device=self.config.name, advice="Set word_order to auto.")
        self.word_order = order

    async def _long(self, registers: tuple[int, ...], entry: OdEntry, deadline: Deadline) -> int:
        """Take a 32 bit value out of the image."""
        big, little = self.tx.both_orders(registers, key(entry), signed=entry.signed)
        if big == little or self.word_order is not None:
            return little if self.word_order == "little" else big
        exact = await self.read(entry, deadline)
        shown = order_shown(big, little, exact)
        if shown is not None:
            self.note_word_order(shown)
        return exact

    @contextmanager
    def _about(self, entry: OdEntry | None = None) -> Iterator[None]:
        """Let an error say which axis, and which object, it is about."""
        try:
            yield
        except DeviceError as exc:
            exc.axis, exc.object = self.config.name, entry.place if entry else None
            raise
