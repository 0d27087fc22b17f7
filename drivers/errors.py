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
+-- LightError              the lamps or their relay
"""


class DeviceError(Exception):
    """Base of everything raised by the drivers.

    `device` names the device; an error about one axis as a whole has the axis' name there. `advice` says what to do
    next. What else is known of the error stands in its fields, each None when it is not known:

    - `axis`: the axis whose drive was asked when the line or the drive failed, by its name in the configuration.
    - `object`: the object that was read or written, index and subindex as in the drive's manual: "6041h:00".
    - `drive_code`: the drive's own error code, object 603Fh.
    - `exception`: the refusal's number: below 256 a Modbus exception code, else an SDO abort code.
    """

    default_advice = "See the log for what happened just before."

    def __init__(self, message: str, *, device: str, advice: str | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.device = device
        self.advice = advice if advice is not None else self.default_advice
        self.axis: str | None = None
        self.object: str | None = None
        self.drive_code: int | None = None
        self.exception: int | None = None

    def __str__(self) -> str:
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

    default_advice = "Give the operation more time."


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

    def __init__(self, message: str, *, device: str, code: int, advice: str | None = None) -> None:
        super().__init__(message, device=device, advice=advice)
        self.code = self.exception = code


class MotionError(DeviceError):
    """The machine did not do what it was told.

    Examples: a state change that never came, a set-point that was not acknowledged. `drive_code` is object 603Fh,
    where the drive named an error; zero means that it named none.
    """

    default_advice = "Look at the axis, then reset and home again."

    def __init__(self, message: str, *, device: str, advice: str | None = None, drive_code: int = 0) -> None:
        super().__init__(message, device=device, advice=advice)
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

    def __init__(self, message: str, *, device: str, code: int, advice: str | None = None) -> None:
        super().__init__(message, device=device, advice=advice, drive_code=code)
        self.code = code


class LimitHit(MotionError):
    """An axis ran onto a limit switch or the drive's own position limit.

    Examples: a lost reference after a collision, a limit switch stuck closed.
    """

    default_advice = "Free the axis by hand or with a short move away from the switch, then home again."


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


class LightError(DeviceError):
    """The lamps could not be switched, or their relay reads back something else.

    Examples: the relay board has no power, a coil that does not follow.
    """

    default_advice = "Check the relay board's power, address and wiring."
