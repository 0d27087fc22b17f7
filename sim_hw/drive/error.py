"""Errors of a drive: numbers of the drive manual's list, with what 1001h, 1003h and 603Fh show of them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class DriveError:
    """One error: its number, its class bit of 1001h, its 16-bit code in 603Fh."""

    number: int
    register: int
    code: int

    @property
    def entry(self) -> int:
        """Return the 1003h entry: number, class, code."""
        return self.number << 24 | self.register << 16 | self.code


UNDER_VOLTAGE = DriveError(3, 0x04, 0x3220)
NEGATIVE_LIMIT = DriveError(10, 0x20, 0x8612)
POSITIVE_LIMIT = DriveError(11, 0x20, 0x8612)
FOLLOWING = DriveError(13, 0x20, 0x8611)
