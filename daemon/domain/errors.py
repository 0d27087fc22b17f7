"""Faults: every kind with its stable code, its name, what caused it and what to do.

Ranges: 1xxx the request, 2xxx seeing, 3xxx motion, 4xxx link, light and camera, 5xxx safety, 9xxx internal.
Codes and names are part of the wire contract: new ones may be added, old ones never change.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from types import MappingProxyType
from typing import Any, NamedTuple


class _Kind(NamedTuple):
    code: int
    cause: str
    advice: str
    latched: bool = False
    cured_by: frozenset[str] = frozenset()
    """Operations that may begin in this fault, and clear it when they come to their end."""


class FaultCode(Enum):
    """One kind of trouble; the member's name in lower case is its name on the wire.

    A latched kind keeps the daemon in `fault` until `reset`, or until a job that cures it (`home` for `not_homed`,
    `lift` or `home` for `needle_down`, which no `reset` clears); the others clear themselves.
    """

    BAD_JSON = _Kind(1001, "the message is not one frame of JSON", "send one UTF-8 JSON object in one frame")
    INVALID_REQUEST = _Kind(1002, "a field is missing, unknown or out of range", "correct the fields named in detail")
    UNKNOWN_OP = _Kind(1003, "there is no such operation", "use one of the operations `describe` lists")
    UNSUPPORTED_VERSION = _Kind(1004, "this daemon does not speak that version", 'send "v": 1')
    MESSAGE_TOO_LARGE = _Kind(1005, "the message is larger than the limit", "send less than the limit in detail")
    UNKNOWN_TEST_POINT = _Kind(1006, "the board has no test point of that name", "see `describe` for the names")
    STALE_DEADLINE = _Kind(1007, "the deadline had passed before the work began", "send a later deadline_ms")
    ID_REUSED = _Kind(1008, "this id was used for a different request", "use a fresh id for each new request")
    BUSY = _Kind(1009, "the queue of jobs is full", "wait for a result, then try again")
    UNKNOWN_JOB = _Kind(1010, "no job of that id is known", "check the id; results are kept as long as the journal")
    NOT_AT_TEST_POINT = _Kind(1011, "the head is not at that test point", "send `place` for it first")
    CANCELLED = _Kind(1012, "the job was cancelled", "send a new request when ready")
    DEADLINE_MISSED = _Kind(1013, "the job did not finish before its deadline", "allow more time or find what is slow")
    SHUTTING_DOWN = _Kind(1014, "the daemon is stopping", "send the request again once it is back")
    NOT_ALLOWED = _Kind(1015, "the client's role does not allow the operation", "use a key of the role named in detail")
    KEY_REVOKED = _Kind(1016, "the client's key is not on the allow-list any more", "ask for a new key")
    RATE_LIMITED = _Kind(1017, "requests come faster than the limit", "wait retry_after_ms, then ask less often")
    UNKNOWN_ALERT = _Kind(1018, "no such alert stands", "see `alerts` for those that stand")

    TIP_NOT_FOUND = _Kind(2101, "the probe tip was not found", "look at the saved picture; clean or re-teach the probe")
    TEST_POINT_NOT_FOUND = _Kind(2201, "no pad was found near the tip", "check the board's alignment and the red light")
    UNDECIDED = _Kind(2202, "an object near the tip could not be decided", "look at the saved picture")
    AMBIGUOUS = _Kind(2203, "more than one pad could be the one meant", "check the board's alignment")
    FRAME_UNUSABLE = _Kind(2301, "the picture is too dark, too bright or blurred", "check lamps, exposure and focus")

    NOT_CONVERGING = _Kind(3101, "the correction did not make the error smaller", "calibrate the map again")
    CORRECTION_TOO_LARGE = _Kind(3102, "the correction is beyond the calibrated radius", "check the board's alignment")
    CALIBRATION_FAILED = _Kind(
        3103, "the calibration was refused; the old one stays", "see detail, then calibrate again"
    )
    MOTION_FAILED = _Kind(3201, "an axis did not do what it was told", "find the cause, then `reset`", latched=True)
    WRONG_HEIGHT = _Kind(
        3203,
        "the needle touches the board where it should hover",
        "see that this board lies flat in its nest, then `calibrate` its surface",
    )
    AXIS_STALLED = _Kind(3202, "an axis stopped short", "clear the axis, then `reset` and `home`", latched=True)

    LINK_LOST = _Kind(4101, "the bus does not answer", "check cable, power and address, then `reset`", latched=True)
    DEVICE_REFUSED = _Kind(4102, "a drive refused a command", "see detail, then `reset`", latched=True)
    LIGHT_FAILED = _Kind(4201, "the light did not switch", "check the relay, then `reset`", latched=True)
    CAMERA_FAILED = _Kind(4301, "the camera gives no frame", "check cable and device, then `reset`", latched=True)

    NOT_HOMED = _Kind(5101, "the axes are not homed", "send `home`", latched=True, cured_by=frozenset({"home"}))
    OUTSIDE_ENVELOPE = _Kind(5102, "the target lies outside the envelope", "choose another head angle or test point")
    NOT_CALIBRATED = _Kind(5103, "there is no valid calibration", "teach the tip, then calibrate the map")
    LIMIT_HIT = _Kind(5104, "a limit switch was hit", "free the axis, then `reset` and `home`", latched=True)
    EMERGENCY_STOP = _Kind(5105, "emergency stop", "release it, then `reset` and `home`", latched=True)
    NOT_ALIGNED = _Kind(
        5108, "the board in the nest has not been aligned", "send `align`; see that the board lies flat"
    )
    IN_FAULT = _Kind(5106, "the daemon is in fault", "see the first cause in detail, then `reset`")
    NEEDLE_DOWN = _Kind(
        5107,
        "the needle is not known to be up",
        "see that it may be raised, then send `lift`; where the axes are not homed, `home`",
        latched=True,
        cured_by=frozenset({"lift", "home"}),
    )

    INTERNAL = _Kind(9001, "the daemon met an error of its own", "report it with the journal entry", latched=True)
    INTERRUPTED = _Kind(9002, "the daemon stopped in the middle of this job", "check the head, then send a new request")
    JOURNAL_FAILED = _Kind(9003, "the journal cannot be written", "free disk space, then `reset`", latched=True)

    @property
    def wire_name(self) -> str:
        """Name on the wire."""
        return self.name.lower()

    @property
    def code(self) -> int:
        """Stable number on the wire."""
        return self.value.code

    @property
    def latched(self) -> bool:
        """Whether a person has to act before the daemon works again."""
        return self.value.latched

    @property
    def cured_by(self) -> frozenset[str]:
        """Operations that may begin in this fault, and clear it when they come to their end."""
        return self.value.cured_by


REFERENCE_LOST = frozenset(
    {FaultCode.MOTION_FAILED, FaultCode.AXIS_STALLED, FaultCode.LIMIT_HIT, FaultCode.EMERGENCY_STOP}
)
"""After these an axis may not stand where its drive believes: only homing settles it."""


class Fault(Exception):
    """Carry one kind of trouble with its message and its facts.

    Raised inside jobs and request handling; turned into an error reply or a failed result at the edge.
    """

    def __init__(self, kind: FaultCode, message: str = "", **detail: Any) -> None:
        super().__init__(message or kind.value.cause)
        self.kind = kind
        self.detail: Mapping[str, Any] = MappingProxyType(detail)

    @property
    def message(self) -> str:
        """What happened, in a sentence."""
        return str(self)

    @property
    def advice(self) -> str:
        """What to do next."""
        return str(self.detail.get("advice") or self.kind.value.advice)
