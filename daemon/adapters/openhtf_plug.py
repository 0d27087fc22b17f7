"""OpenHTF plug: phases test points of the board on a reprobe station. Needs OpenHTF (`pip install 'reprobe[openhtf]'`).

@plugs.plug(reprobe=ReprobePlug)
@measurements.measures(measurements.Measurement("clk_ohms").in_range(maximum=2.0))
def clk(test, reprobe):
    test.measurements.clk_ohms = reprobe.probe("TP1", board_id=test.test_record.dut_id).ohms
"""

from __future__ import annotations

from typing import Any

from openhtf.plugs import BasePlug
from openhtf.util import configuration

from daemon.adapters.prober import Probed, Prober
from daemon.client import DEFAULT_CONTROL, Client
from daemon.domain.point_test import PointTest

configuration.CONF.declare(
    "reprobe_station", default_value=DEFAULT_CONTROL, description="control socket of the station's daemon"
)


class ReprobePlug(BasePlug):  # type: ignore[misc]  # OpenHTF is not typed for everybody who checks this
    """A connection to the station that the configuration key `reprobe_station` names."""

    def __init__(self, endpoint: str | None = None) -> None:
        self._client = Client(endpoint or configuration.CONF.reprobe_station)
        self._prober = Prober(self._client)

    def probe(self, point: str | PointTest, *, board_id: str | None = None, **fields: Any) -> Probed:
        """Test a point; `board_id` is the unit's serial number, by which the touches of its pads are counted.

        Raises:
            NotMeasured: from the answer's `ohms`, `volts` or `farads`, where contact was not made.
            StationTrouble: the station could not test it.
            Refused: it did not take the job.
            NoAnswer: it does not answer.

        """
        return self._prober(point, board_id=board_id, **fields)

    def tearDown(self) -> None:  # OpenHTF calls it so
        """Let go of the connection."""
        self._client.close()
