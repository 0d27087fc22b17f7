"""Prober: asks a station to test points, and says what came of each in one word and in numbers.

All that makes a point's test hard (looking, correcting, pumping, proving contact) happens below it, in the station.
"""

from __future__ import annotations

import math
from typing import Any

from daemon.client import Client
from daemon.domain.point_test import PointRecord, PointTest, PointUnit, PointVerdict
from daemon.domain.results import ErrorBody

PASSES = (PointVerdict.PASS_FIRST, PointVerdict.PASS_RECOVERED)
NOBODY_KNOWS = (PointVerdict.CONTACT_NOT_MADE, PointVerdict.NOT_TESTED)
LONGEST_S = 600.0


class NotMeasured(Exception):
    """A value was asked for, and there is none: contact was not made, or the point could not be tested."""


class StationTrouble(Exception):
    """The station could not do its work; what it says is about itself, and not about the board."""

    def __init__(self, point: str, error: ErrorBody) -> None:
        super().__init__(f"{point}: {error.message} ({error.name}); {error.advice}")
        self.error = error


class Probed:
    """What came of one point's test. `record` has all of it."""

    def __init__(self, record: PointRecord) -> None:
        self.record = record

    def __repr__(self) -> str:
        """Return what a failed assertion should show."""
        how = f", recovered by {self.record.recovered_by}" if self.record.recovered_by else ""
        why = f", {self.record.reason}" if self.record.reason else ""
        return f"<{self.record.point}: {self.record.verdict}{how}{why}>"

    def __bool__(self) -> bool:
        """Tell whether the point passed."""
        return self.passed

    @property
    def verdict(self) -> PointVerdict:
        """How the test ended."""
        return self.record.verdict

    @property
    def passed(self) -> bool:
        """Whether the value is within its limits, at the first touch or later."""
        return self.record.verdict in PASSES

    @property
    def ohms(self) -> float:
        """The last reading; infinite for an open that is confirmed."""
        return self._value("ohm")

    @property
    def volts(self) -> float:
        """The last reading of a voltage or a diode."""
        return self._value("V")

    @property
    def farads(self) -> float:
        """The last reading of a capacitance."""
        return self._value("F")

    def _value(self, unit: PointUnit) -> float:
        record = self.record
        if record.verdict in NOBODY_KNOWS:
            raise NotMeasured(f"{record.point} was not measured: {record.verdict}. {record.reason}".strip())
        last = record.readings[-1] if record.readings else None
        if last is None or last.unit != unit:
            read = "nothing" if last is None or last.unit is None else last.unit
            raise NotMeasured(f"{record.point} was tested by {record.method}, which reads {read} and not {unit}")
        return math.inf if last.overload or last.value is None else last.value


class Prober:
    """Tests points of one board on one station."""

    def __init__(self, client: Client, board_id: str | None = None) -> None:
        self.client = client
        self.board_id = board_id

    def __call__(self, point: str | PointTest, **fields: Any) -> Probed:
        """Test a point, by its name or as a plan has it; `fields` are those of `Client.probe`, such as `method`.

        With `measure` the caller's own instrument measures while the needle stands.

        Raises:
            StationTrouble: the station could not test it.
            Refused: it did not take the job, as for a point that it does not know.
            NoAnswer: it does not answer.

        """
        asked = {"test_point": point} if isinstance(point, str) else _request(point)
        result = self.client.probe(**{"timeout_s": LONGEST_S, "board_id": self.board_id, **asked, **fields})
        if result.error is not None:
            raise StationTrouble(str(asked["test_point"]), result.error)
        return Probed(PointRecord.model_validate(result.detail["record"]))


def _request(test: PointTest) -> dict[str, Any]:
    """Return the fields of a request for what a line of a plan asks."""
    asked = test.model_dump(
        mode="json", include={"method", "limits", "theta_deg", "look", "touches"}, exclude_none=True
    )
    return {"test_point": test.point, **asked}
