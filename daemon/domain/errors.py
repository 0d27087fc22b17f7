"""Faults: every kind with its stable code, its name, what caused it and what to do.

Ranges: 1xxx the request, 2xxx seeing, 3xxx motion, 4xxx link, light and camera, 5xxx safety, 6xxx contact,
9xxx internal.
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
    DEADLINE_MISSED = _Kind(
        1013,
        "the job did not finish before its deadline",
        "see in the result's times what took long; then ask with a later deadline_ms, or with none",
    )
    SHUTTING_DOWN = _Kind(1014, "the daemon is stopping", "send the request again once it is back")
    NOT_ALLOWED = _Kind(1015, "the client's role does not allow the operation", "use a key of the role named in detail")
    KEY_REVOKED = _Kind(1016, "the client's key is not on the allow-list any more", "ask for a new key")
    RATE_LIMITED = _Kind(1017, "requests come faster than the limit", "wait retry_after_ms, then ask less often")
    UNKNOWN_ALERT = _Kind(1018, "no such alert stands", "see `alerts` for those that stand")
    NOT_THE_HOLDER = _Kind(
        1019, "another client holds the needle down", "`cancel` lifts it, whoever asks; else wait for its end"
    )
    VERDICT_NOT_KEPT = _Kind(
        1020,
        "the touch had ended before the verdict came, or another one was said first",
        "see `result` for what was kept; touch again if that is not what was measured",
    )
    INVALID_PLAN = _Kind(1021, "the plan cannot be used", "correct what the message names, then store it again")
    UNKNOWN_PLAN = _Kind(1022, "no plan of that name is stored", "see `reprobe plan list`, or store it")
    WRONG_PLAN = _Kind(1023, "the plan is for another board", "take the plan of the station's board")
    PLAN_NOT_APPROVED = _Kind(
        1024, "the plan's limits were learned and nobody has approved them", "look at them, then approve the plan"
    )
    RUN_UNFINISHED = _Kind(
        1025, "a run of this board is unfinished", "send it again with `resume`, or with `abandon` to start over"
    )
    UNKNOWN_RUN = _Kind(1026, "no such run is known", "check the id; runs are kept as long as the journal")

    UNKNOWN_PICTURE = _Kind(
        1031,
        "no such picture of that job is kept",
        "see `pictures` for those that are; the oldest make room for new ones",
    )
    CHARTS_NOT_DRAWN = _Kind(
        1032, "the charts of the month could not be drawn", "ask again later; `reprobe month` draws them, too"
    )

    TIP_NOT_FOUND = _Kind(
        2101,
        "the probe tip was not found",
        "look at the kept picture: is the needle lit and clean? Clean it; if it was changed or bent, `calibrate tip`",
    )
    TEST_POINT_NOT_FOUND = _Kind(
        2201,
        "no pad was found near the tip",
        "see that this board lies in its nest, this side up and clean, then `align`; look at the kept picture",
    )
    UNDECIDED = _Kind(
        2202,
        "what lies near the tip cannot be told from a pad",
        "look at the kept picture: clean the pad, or touch another point of its net",
    )
    AMBIGUOUS = _Kind(
        2203,
        "more than one pad could be the one meant",
        "send `align`, which tells them apart; or touch another point of its net",
    )
    FRAME_UNUSABLE = _Kind(
        2301,
        "the picture is too dark, too bright or blurred",
        "see that the lamp the message names shines and is clean; then check exposure and focus",
    )

    WRONG_PLACE = _Kind(
        2401,
        "the board does not lie where it should",
        "see that the board lies in its nest, then send `align`; if it does, an axis lost steps: `home` first",
    )
    BOARD_TURNED = _Kind(2402, "the board lies turned", "turn the board as the message says, then send `align`")
    WRONG_SIDE = _Kind(2403, "the board lies with its other side up", "turn the board over, then send `align`")
    NO_BOARD = _Kind(2404, "there is no board below the camera", "lay the board into its nest, then send `align`")
    NOT_THIS_BOARD = _Kind(
        2405,
        "what lies below the camera is not what the board file says",
        "see that this is the board of the board file, and clean; the picture is kept",
    )
    TARGET_NOT_CONFIRMED = _Kind(
        2406,
        "the board lies as it should, but the pad is not seen where CAD has it",
        "look at the kept picture: clean the pad, or take off what covers it",
    )
    DISAGREE = _Kind(
        2407,
        "CAD and the pad's own outline put the pad at two places",
        "look at the kept picture: is there dirt or a dent on the pad? Clean it, or touch another point of its net",
    )

    NOT_CONVERGING = _Kind(
        3101,
        "the correction did not make the error smaller",
        "see that needle and camera sit firmly, then `calibrate map`",
    )
    CORRECTION_TOO_LARGE = _Kind(
        3102,
        "the pad lies further off than may be corrected",
        "see that the board lies in its nest, then `align`; if it does, `home`: an axis may have lost steps",
    )
    CALIBRATION_FAILED = _Kind(
        3103, "the calibration was refused; the old one stays", "do what the message says, then that calibration again"
    )
    MOTION_FAILED = _Kind(
        3201,
        "an axis did not do what it was told",
        "free the axis that the message names, then `reset` and `home`",
        latched=True,
    )
    WRONG_HEIGHT = _Kind(
        3203,
        "the needle touches the board where it should hover",
        "see that this board lies flat in its nest, then `calibrate surface`",
    )
    AXIS_STALLED = _Kind(3202, "an axis stopped short", "clear the axis, then `reset` and `home`", latched=True)

    LINK_LOST = _Kind(
        4101,
        "the bus does not answer",
        "check cable, power and address of what the message names, then `reset`",
        latched=True,
    )
    DEVICE_REFUSED = _Kind(
        4102,
        "a drive refused a command",
        "compare the drive that the message names with the configuration, then `reset`",
        latched=True,
    )
    LIGHT_FAILED = _Kind(
        4201, "the light did not switch", "check the relay's power, its cable and the lamp, then `reset`", latched=True
    )
    CAMERA_FAILED = _Kind(4301, "the camera gives no frame", "check cable and device, then `reset`", latched=True)

    NOT_HOMED = _Kind(5101, "the axes are not homed", "send `home`", latched=True, cured_by=frozenset({"home"}))
    OUTSIDE_ENVELOPE = _Kind(5102, "the target lies outside the envelope", "choose another head angle or test point")
    NOT_CALIBRATED = _Kind(
        5103,
        "there is no valid calibration",
        "make what the message names: `calibrate tip`, then `calibrate map`",
    )
    LIMIT_HIT = _Kind(5104, "a limit switch was hit", "free the axis, then `reset` and `home`", latched=True)
    EMERGENCY_STOP = _Kind(
        5105,
        "the emergency stop was pressed, or the motors' supply failed",
        "release it, then `reset` and `home`",
        latched=True,
    )
    NOT_ALIGNED = _Kind(
        5108, "the board in the nest has not been aligned", "send `align`; see that the board lies flat"
    )
    SURFACE_UNKNOWN = _Kind(
        5109,
        "nobody knows how high this board lies below the needle",
        "see that it lies flat, then `calibrate surface`",
    )
    IN_FAULT = _Kind(
        5106, "the daemon is in fault", "mend the cause that the message names, then `reset`; `status` shows it, too"
    )
    NEEDLE_DOWN = _Kind(
        5107,
        "the needle is not known to be up",
        "see that it may be raised, then send `lift`; where the axes are not homed, `home`",
        latched=True,
        cured_by=frozenset({"lift", "home"}),
    )

    CONTACT_NOT_MADE = _Kind(
        6101, "the needle made no contact that could be proved", "look at the pad and at the needle's end"
    )
    CONTACT_BEFORE_DESCENT = _Kind(
        6102,
        "the proof of contact is closed while the needle is up",
        "see that the needle's two wires do not touch, and that meter.contact_channel is right",
    )
    PROBE_BAD = _Kind(
        6103,
        "the needle makes no good contact on the reference pad, brushed or not",
        "clean or change the needle, see that its wires are whole, then `reset`",
        latched=True,
    )
    TOUCH_BUDGET_SPENT = _Kind(
        6104, "this pad of this board was touched as often as it may be", "take another point of the same net"
    )
    POINT_FORBIDDEN = _Kind(
        6110, "a person has forbidden this point to the needle", "take another point of the net; or approve it: `mark`"
    )
    LEASE_EXPIRED = _Kind(
        6105,
        "nobody renewed the lease, so that the needle was lifted",
        "send `hold` before the lease ends, or a longer one",
    )
    METER_FAILED = _Kind(
        6106, "the measuring instrument gives no value", "check it as the message says, then try again"
    )
    LOOK_NEEDED = _Kind(
        6107,
        "the point was pressed before and has not been seen since, or it was seen beside the tip",
        "send `correct` for it, then touch again",
    )

    ANOTHER_PRESS = _Kind(
        6109,
        "what was said is of another press than the one in which the needle stands",
        "measure in the press that `contact` tells of, and name that one (`press`)",
    )

    INTERNAL = _Kind(
        9001,
        "the daemon met an error of its own",
        "it is a defect: hand on a support bundle (`reprobe bundle`), then `reset`",
        latched=True,
    )
    INTERRUPTED = _Kind(
        9002, "the daemon stopped in the middle of this job", "see where the needle is (`status`), then ask anew"
    )
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
    def way_out(self) -> str:
        """What a person types once the cause is gone; empty where it clears itself."""
        if not self.latched:
            return ""
        if self.cured_by:
            return "`lift`" if "lift" in self.cured_by else "`home`"
        return "`reset` and `home`" if self in REFERENCE_LOST else "`reset`"

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
        """What to do next; of a fault that stays, with what clears it: advice of a device knows the device alone."""
        own = str(self.detail.get("advice") or self.kind.value.advice)
        way_out = self.kind.way_out
        if not way_out or way_out.split()[0].strip("`") in own.lower():
            return own
        return f"{own.rstrip('. ')}, then {way_out}"
