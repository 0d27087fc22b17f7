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
|   +-- EmergencyStop       switched off from outside, or by a quick stop
+-- CameraError             the camera
|   +-- CameraTimeout       no fresh picture in time (also a TimeoutError)
+-- LightError              the lamps or their relay
"""


class DeviceError(Exception):
    """Base of everything raised by the drivers.

    `device` names the device as the configuration does; `advice` says what to do next.
    """

    default_advice = "See the log for what happened just before."

    def __init__(self, message: str, *, device: str, advice: str | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.device = device
        self.advice = advice if advice is not None else self.default_advice

    def __str__(self) -> str:
        return f"{self.device}: {self.message}"


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
    number.
    """

    default_advice = "Compare the device's model and firmware with the configuration."

    def __init__(self, message: str, *, device: str, code: int, advice: str | None = None) -> None:
        super().__init__(message, device=device, advice=advice)
        self.code = code


class MotionError(DeviceError):
    """The machine did not do what it was told.

    Examples: a state change that never came, a set-point that was not acknowledged.
    """

    default_advice = "Look at the axis, then reset and home again."


class MotionTimeout(MotionError, TimeoutError):
    """A move, a homing run or a state change took longer than its deadline.

    Examples: the deadline was shorter than the way, the speed is set far too low.
    """

    default_advice = "Check the axis' speed and the deadline given for the move."


class DriveFault(MotionError):
    """The drive is in its fault state; `code` is object 603Fh.

    Examples: over-voltage, over-temperature, encoder error.
    """

    default_advice = "Remove the cause the drive names, then reset."

    def __init__(self, message: str, *, device: str, code: int, advice: str | None = None) -> None:
        super().__init__(message, device=device, advice=advice)
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
    """The drives were stopped or switched off while moving.

    Examples: the e-stop button, the drive's voltage gone, a quick stop by the program.
    """

    default_advice = "Release the emergency stop when it is safe, then reset and home."


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
