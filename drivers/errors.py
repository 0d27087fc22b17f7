"""What can go wrong between the program and the hardware.

DeviceError
+-- LinkError               the wire: no port, no connection
|   +-- LinkTimeout         the wire: no answer in time (also a TimeoutError)
|       +-- DeadlinePassed  the caller's time was over before the answer came
+-- ReplyError              the wire: an answer that does not fit the question
+-- DeviceRefused           the device understood and said no (has a code)
+-- MotionError             the machine
|   +-- MotionTimeout       did not get there in time (also a TimeoutError)
|   +-- DriveFault          the drive reports a fault (has a code)
|   +-- LimitHit            a limit switch or a software limit
|   +-- Stalled             blocked, or not where it should be
|   +-- NotHomed            the drive does not know where it is
|   +-- EnvelopeViolation   the caller asked for a place outside
|   +-- EmergencyStop       motor power cut or drive switched off from outside, or a quick stop by the program
+-- CameraError             the camera
|   +-- CameraTimeout       no fresh picture in time (also a TimeoutError)
|   +-- FrameLost           one picture that was exposed did not arrive whole
+-- LightError              the lamps or their relay
+-- MeterError              the measuring instrument (its `trouble` says what kind)
    +-- MeterTimeout        no answer in time (also a TimeoutError)
"""

from enum import Enum


class DeviceError(Exception):
    """Base of everything raised by the drivers.

    `message` is for who runs the station: no name of a register or a function. `technical` has those, for who mends the
    drive or the line; `str()` gives both. `device` names the device; an error about one axis as a whole has the axis'
    name there. `advice` says what to do next. What else is known stands in fields, each None when it is not known:

    - `axis`: the axis whose drive was asked when the line or the drive failed, by its name in the configuration.
    - `object`: the object that was read or written, index and subindex as in the drive's manual: "6041h:00".
    - `drive_code`: the drive's own error code, object 603Fh.
    - `exception`: the refusal's number: below 0 of SCPI, below 256 of Modbus, else an SDO abort code.
    """

    default_advice = "See the log for what happened just before."

    def __init__(self, message: str, *, device: str, advice: str | None = None, technical: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.technical = technical
        self.device = device
        self.advice = advice if advice is not None else self.default_advice
        self.axis: str | None = None
        self.object: str | None = None
        self.drive_code: int | None = None
        self.exception: int | None = None

    def __str__(self) -> str:
        return f"{self.in_words}{f' ({self.technical})' if self.technical else ''}"

    @property
    def in_words(self) -> str:
        """Say what happened to which device, for who runs the station."""
        return f"{self.device}: {self.message}"

    def fields(self) -> dict[str, str | int]:
        """Give the fields that are known, by their names."""
        known: dict[str, str | int | None] = {
            "axis": self.axis,
            "object": self.object,
            "drive_code": self.drive_code,
            "exception": self.exception,
        }
        return {name: value for name, value in known.items() if value is not None}


class LinkError(DeviceError):
    """The wire to the device does not work.

    Examples: the serial port is missing, another process holds it, the USB adapter was unplugged.
    """

    default_advice = "Check that the adapter is plugged in, the port is right and nothing else uses it."


class LinkTimeout(LinkError, TimeoutError):
    """Nothing came back in time.

    Examples: the slave has no power, the RS-485 pair is broken, wrong address, baud rate or parity.
    """

    default_advice = "Check power, cable, slave address, baud rate and parity of the device."


class DeadlinePassed(LinkTimeout):
    """The caller's deadline ended while a request waited or was on the wire; says nothing about the slave.

    Examples: a move's deadline that ends between two looks at the axis, a line busy with other requests.
    """

    default_advice = (
        "Ask again with a later deadline. If it happens again, see in the job's times what is slow: a busy line, a low "
        "speed, a computer under load."
    )


class ReplyError(DeviceError):
    """Something came back that does not answer the question.

    Examples: wrong CRC, an FC 6 reply to an FC 3 request, one register where four were asked for.
    """

    default_advice = "Check the RS-485 termination and shield, and that no two slaves share an address."


class DeviceRefused(DeviceError):
    """The device understood the request and refused it.

    Examples: Modbus exception 02 (illegal address), CANopen abort 06020000h (no such object). `code` is that
    number, and the field `exception` too.
    """

    default_advice = "Compare the device's model and firmware with the configuration."

    def __init__(self, message: str, *, device: str, code: int, advice: str | None = None, technical: str = "") -> None:
        super().__init__(message, device=device, advice=advice, technical=technical)
        self.code = self.exception = code


class MotionError(DeviceError):
    """The machine did not do what it was told.

    Examples: a state change that never came, a set-point that was not acknowledged. `drive_code` is object 603Fh,
    where the drive named an error; zero means that it named none.
    """

    default_advice = "Look at the axis, then reset and home again."

    def __init__(
        self, message: str, *, device: str, advice: str | None = None, drive_code: int = 0, technical: str = ""
    ) -> None:
        super().__init__(message, device=device, advice=advice, technical=technical)
        self.drive_code = drive_code or None


class MotionTimeout(MotionError, TimeoutError):
    """A move, a homing run or a state change took longer than its deadline.

    Examples: the deadline was shorter than the way, the speed is set far too low.
    """

    default_advice = "Check the axis' speed and the deadline given for the move."


class DriveFault(MotionError):
    """The drive is in its fault state; `code` is object 603Fh, zero when it could not be read.

    Examples: over-voltage, over-temperature, encoder error.
    """

    default_advice = "Remove the cause the drive names, then reset."

    def __init__(self, message: str, *, device: str, code: int, advice: str | None = None, technical: str = "") -> None:
        super().__init__(message, device=device, advice=advice, drive_code=code, technical=technical)
        self.code = code


class LimitHit(MotionError):
    """An axis ran onto a limit switch or the drive's own position limit.

    Examples: a lost reference after a collision, a limit switch stuck closed.
    """

    default_advice = "Free the axis by hand or with a short move away from the switch, then reset and home."


class Stalled(MotionError):
    """An axis is blocked or did not arrive where it reports to be.

    Examples: a following error, a motor-blocked fault, a position that stopped changing.
    """

    default_advice = "Clear whatever blocks the axis, then reset and home again."


class NotHomed(MotionError):
    """An axis has no reference.

    Examples: first start after power-up, power lost since the last homing run, the homing settings changed.
    """

    default_advice = "Home the machine."


class EnvelopeViolation(MotionError):
    """The target lies outside of what the machine may reach; nothing moved.

    Examples: a typing error in a coordinate, a head angle in the forbidden band.
    """

    default_advice = "Ask for a target inside the envelope."


class EmergencyStop(MotionError):
    """A drive lost its motor power or was switched off from outside, at rest or in a move; or the program stopped it.

    Examples: the e-stop button held or pressed for a moment, the drive's voltage gone, a quick stop by the program.
    A supply that fails by itself looks the same to the drive and is raised as this too: the cure is the same.
    """

    default_advice = (
        "Release the emergency stop when it is safe, then reset and home. "
        "If nobody pressed it, check the motor supply first."
    )


class CameraError(DeviceError):
    """The camera cannot be opened, read or set.

    Examples: device missing, no such format, the stream's server gone.
    """

    default_advice = "Check the camera's cable and that nothing else has it open."


class CameraTimeout(CameraError, TimeoutError):
    """No picture exposed late enough came in time.

    Examples: frozen camera, torn pictures only, cable out, a deadline shorter than two frame periods.
    """

    default_advice = "Check the camera's cable and light; re-plug it if it stays frozen."


class FrameLost(CameraError):
    """A picture that was exposed did not arrive whole; the next one may.

    Examples: torn on its way, the camera went while it was sent.
    """

    default_advice = "Check the camera's cable, and that nothing else uses its line."


class LightError(DeviceError):
    """The lamps could not be switched, or their relay reads back something else.

    Examples: the relay board has no power, a coil that does not follow.
    """

    default_advice = "Check the relay board's power, address and wiring."


class MeterTrouble(Enum):
    """What is wrong with a measuring instrument, each with what a person does next."""

    ADDRESS = "Set [meter] address to the instrument's host:port or its serial port; see that it is plugged in."
    REFUSED = (
        "Switch the instrument on and its SCPI socket too; check the port (5025 on most). Some serve one client only."
    )
    BUSY = "End the other program that has the port open."
    UNREACHABLE = "Check the instrument's power, network cable and address."
    LOST = "Check the instrument's power and cable; somebody may have switched it off."
    SILENT = "Check that it is on and not in local lock-out, and baud rate, cable and terminator."
    SLOW = "Give it more time ([meter] answer_ms), or measure shorter: fewer NPLC, a fixed range."
    UNFINISHED = "Set [meter] terminator to what ends the instrument's answers; check baud rate and cable."
    GARBAGE = "Check the baud rate, and that the address is the instrument's SCPI port and not another service's."
    DIALECT = "Give this method's commands as the instrument's manual has them: [meter.methods.NAME] commands and read."
    OTHER = "Connect the instrument that [meter] model names, or change the name."
    INVALID = "Look at the instrument: it answered that it has no valid value."


class MeterError(DeviceError):
    """The measuring instrument cannot be reached, does not answer, or does not understand; `trouble` says which.

    Examples: nothing listens at the address, an answer that is no number, a command it does not know (`exception` is
    then its SCPI error number, below zero).
    """

    def __init__(self, message: str, trouble: MeterTrouble, *, device: str = "meter", code: int | None = None) -> None:
        super().__init__(message, device=device, advice=trouble.value)
        self.trouble = trouble
        self.exception = code

    def fields(self) -> dict[str, str | int]:
        """Give the fields that are known, by their names, and the kind of trouble in lower case."""
        return {**super().fields(), "trouble": self.trouble.name.lower()}


class MeterTimeout(MeterError, TimeoutError):
    """The measuring instrument did not answer in time.

    Examples: it is off, it integrates for longer than it is waited for, its answers end otherwise than configured.
    """
