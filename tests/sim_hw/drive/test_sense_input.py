"""The touch sense at the Z drive's fourth input."""

import pytest

from tests.sim_hw.rig import Rig

SENSE = 1 << 19


def test_the_sense_is_raw_input_four_of_the_z_drive_and_acts_as_no_switch() -> None:
    rig = Rig("z")
    rig.plant.sense = lambda t_s: t_s >= 2.0
    open_ = rig.read(0x60FD, kind="I")
    rig.t_s = 2.5
    closed = rig.read(0x60FD, kind="I")
    assert (open_ & SENSE, closed) == (0, open_ | SENSE)
    assert rig.read(0x3240, sub=5, kind="I") >> 3 & 1 == 1


@pytest.mark.parametrize("axis", ["x", "y", "theta"])
def test_no_other_drive_has_it(axis: str) -> None:
    rig = Rig(axis)
    rig.plant.sense = lambda _t_s: True
    assert rig.read(0x60FD, kind="I") & SENSE == 0
