"""The drive's objects and bits (CiA 402 and the maker's own), by their names in the manual. Pure."""

from enum import Enum, IntEnum

from drivers.bus import OdEntry

# ---------------------------------------------------------------- objects
ERROR_REGISTER = OdEntry(0x1001, 0, 1)
# Newest entry of the error stack; aborts with 08000024h when the stack is empty
ERROR_STACK_TOP = OdEntry(0x1003, 1, 4)
# Vendor number; 0000026Ch is Nanotec
VENDOR_ID = OdEntry(0x1018, 1, 4)
PRODUCT_CODE = OdEntry(0x1018, 2, 4)
REVISION = OdEntry(0x1018, 3, 4)
SERIAL_NUMBER = OdEntry(0x1018, 4, 4)
# NanoJ inputs: volatile, zero at power-up. The last one keeps our homed marker
HOMED_MARKER = OdEntry(0x2400, 0x20, 4)
# Bits that say how the motor is driven: open or closed loop, current reduction and the like; the upper half is empty
MOTOR_MODE = OdEntry(0x3202, 0, 4)
# Which inputs act as switches: bit 0 negative limit, 1 positive limit, 2 home
SWITCH_INPUTS = OdEntry(0x3240, 1, 4)
TX_MAPPING = 0x3602
ERROR_CODE = OdEntry(0x603F, 0, 2)
CONTROLWORD = OdEntry(0x6040, 0, 2)
STATUSWORD = OdEntry(0x6041, 0, 2)
MODE = OdEntry(0x6060, 0, 1, signed=True)
MODE_DISPLAY = OdEntry(0x6061, 0, 1, signed=True)
POSITION_ACTUAL = OdEntry(0x6064, 0, 4, signed=True)
TARGET_POSITION = OdEntry(0x607A, 0, 4, signed=True)
HOME_OFFSET = OdEntry(0x607C, 0, 4, signed=True)
SOFTWARE_LIMIT_MIN = OdEntry(0x607D, 1, 4, signed=True)
SOFTWARE_LIMIT_MAX = OdEntry(0x607D, 2, 4, signed=True)
PROFILE_VELOCITY = OdEntry(0x6081, 0, 4)
PROFILE_ACCELERATION = OdEntry(0x6083, 0, 4)
PROFILE_DECELERATION = OdEntry(0x6084, 0, 4)
QUICK_STOP_DECELERATION = OdEntry(0x6085, 0, 4)
HOMING_METHOD = OdEntry(0x6098, 0, 1, signed=True)
HOMING_SPEED_SWITCH = OdEntry(0x6099, 1, 4)
HOMING_SPEED_ZERO = OdEntry(0x6099, 2, 4)
HOMING_ACCELERATION = OdEntry(0x609A, 0, 4)
POSITION_UNIT = OdEntry(0x60A8, 0, 4)
SPEED_UNIT = OdEntry(0x60A9, 0, 4)
FOLLOWING_ERROR = OdEntry(0x60F4, 0, 4, signed=True)
DIGITAL_INPUTS = OdEntry(0x60FD, 0, 4)

# What a drive's own settings say of the motor and of stops; read only, for a person
SETTINGS = (
    OdEntry(0x2030, 0, 4),
    OdEntry(0x2031, 0, 4),
    MOTOR_MODE,
    SWITCH_INPUTS,
    OdEntry(0x3701, 0, 2, signed=True),
    OdEntry(0x605A, 0, 2, signed=True),
    OdEntry(0x605B, 0, 2, signed=True),
    OdEntry(0x605C, 0, 2, signed=True),
    OdEntry(0x605D, 0, 2, signed=True),
    OdEntry(0x605E, 0, 2, signed=True),
)

VENDOR_NANOTEC = 0x0000026C
# 60A8h: encoder increments, 65536 per pole pair
UNIT_INCREMENTS = 0x00B50000
ABORT_NO_OBJECT = 0x06020000
ABORT_NO_SUBINDEX = 0x06090011
ABORT_EMPTY_STACK = 0x08000024


def mapping_entry(index: int, number: int) -> OdEntry:
    """Give the entry `number` (1..16) of a mapping array; 0 is its count."""
    return OdEntry(index, number, 4 if number else 1)


# ---------------------------------------------------------------- controlword 6040h
class Control(IntEnum):
    """Whole control words; levels, so that writing one twice is the same as once."""

    DISABLE_VOLTAGE = 0x0000
    QUICK_STOP = 0x0002
    SHUTDOWN = 0x0006
    SWITCH_ON = 0x0007
    ENABLE = 0x000F
    # Bit 4: start of a homing run, new set-point of a positioning move
    START = 0x001F
    # Bits 4 and 5: new absolute set-point, taken at once
    NEW_SET_POINT = 0x003F
    FAULT_RESET = 0x0080
    # Bit 8: halt with the power stage on
    HALT = 0x010F


# ---------------------------------------------------------------- statusword 6041h
SW_VOLTAGE = 0b0000_0000_0001_0000
SW_WARNING = 0b0000_0000_1000_0000
SW_TARGET_REACHED = 0b0000_0100_0000_0000
SW_LIMIT_EXCEEDED = 0b0000_1000_0000_0000
# Set-point acknowledged (positioning), homing attained (homing)
SW_ACKNOWLEDGE = 0b0001_0000_0000_0000
# Following error (positioning), homing error (homing)
SW_MODE_ERROR = 0b0010_0000_0000_0000

# 60FDh digital inputs
DI_NEGATIVE_LIMIT = 0b0001
DI_POSITIVE_LIMIT = 0b0010
DI_HOME = 0b0100
DI_INTERLOCK = 0b1000
# From this bit on the inputs as they are wired
DI_RAW_BIT = 16


class Mode(IntEnum):
    """Operation modes of 6060h / 6061h that are used here."""

    NONE = 0
    PROFILE_POSITION = 1
    HOMING = 6


class PowerState(Enum):
    """States of the CiA 402 power machine."""

    NOT_READY = "not ready to switch on"
    SWITCH_ON_DISABLED = "switch on disabled"
    READY = "ready to switch on"
    SWITCHED_ON = "switched on"
    OPERATION_ENABLED = "operation enabled"
    QUICK_STOP_ACTIVE = "quick stop active"
    FAULT_REACTION = "fault reaction active"
    FAULT = "fault"


# Mask 4Fh for the states in which bit 5 (quick stop) says nothing, 6Fh for the others
_BY_4F = {
    0x00: PowerState.NOT_READY,
    0x40: PowerState.SWITCH_ON_DISABLED,
    0x0F: PowerState.FAULT_REACTION,
    0x08: PowerState.FAULT,
}
_BY_6F = {
    0x21: PowerState.READY,
    0x23: PowerState.SWITCHED_ON,
    0x27: PowerState.OPERATION_ENABLED,
    0x07: PowerState.QUICK_STOP_ACTIVE,
}


def decode_state(statusword: int) -> PowerState | None:
    """Give the state a status word shows, or None for a pattern that is none of the standard's."""
    return _BY_4F.get(statusword & 0x4F) or _BY_6F.get(statusword & 0x6F)


# ---------------------------------------------------------------- errors
# 1003h: bits 24..31 of an entry, the maker's error number
ERROR_NUMBER = {
    0: "watchdog reset",
    1: "over-voltage",
    2: "over-current",
    3: "under-voltage",
    4: "field bus",
    5: "turned in a blocked direction",
    7: "encoder",
    8: "encoder",
    9: "encoder",
    10: "negative limit switch and tolerance zone exceeded",
    11: "positive limit switch and tolerance zone exceeded",
    12: "over-temperature (above 80 degC)",
    13: "following error",
    14: "non-volatile memory",
    15: "motor blocked",
    16: "non-volatile memory",
}
UNDER_VOLTAGE_NUMBER = 3
# 603Fh of CiA 402 for the same: mains and intermediate circuit
UNDER_VOLTAGE_CODES = frozenset({0x3120, 0x3220})
LIMIT_NUMBERS = frozenset({10, 11})
BLOCKED_NUMBERS = frozenset({5, 13, 15})


def error_meaning(entry: int) -> str:
    """Say in words what an entry of 1003h means; empty for zero."""
    if entry == 0:
        return ""
    number = entry >> 24
    return ERROR_NUMBER.get(number, f"error number {number}")


def error_numbers(entry: int) -> str:
    """Say which numbers an entry of 1003h has, to stand behind the drive's error code; empty for zero."""
    return f", class {entry >> 16 & 0xFF:02X}h, code {entry & 0xFFFF:04X}h" if entry else ""
